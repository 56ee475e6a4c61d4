"""A generated scene drawn by one backend with one setting of its dials, timed and compared.

The truth of a scene is the `torch` backend's drawing in float64 with limits so low that they cost
no more than float32's rounding (`EXACT`). Smaller pictures are resized to the truth's size, and
their gradients are pulled back through the resizing. Antialiasing has a truth of its own, the mean
of 4 x 4 samples in each pixel (`SUPERSAMPLED`). The low-pass of 0.3 pixels^2 and the clamp of alpha
are no dials: the truth has them, too. Gaussians that are trained with a setting adapt to it, and
may lose less than the errors say.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any
from unittest import mock

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend import (
    Rasterizer,
    numba_tiles,
    projection,
    registry,
    resolve,
    torch_tiles,
)
from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.numba_kernels.pixels import Limits
from desplat_ns.backend.protocol import Rendering, RenderSettings, View
from lab.bench.scenes import PARAMETERS, SH_DEGREE, Scene, tensors_of

LEAST_ALPHA, LEAST_TRANSMITTANCE = 1e-6, 1e-7
"""Limits that stand for none: they cost 1e-6 to 1e-5 of a colour, which float32 rounds away."""


@dataclass(frozen=True)
class Contender:
    """A rasterizer, and the device on which it draws."""

    name: str
    device: str
    rasterizer: Rasterizer


def contenders() -> tuple[list[Contender], dict[str, str]]:
    """Every backend on every device type where it can run, the fastest of the CPU first; the
    backends that run nowhere, each with the reason."""
    runnable: list[Contender] = []
    missing: dict[str, str] = {}
    for device in ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",):
        for name in registry.BACKEND_NAMES[1:]:
            reason = registry.unavailable_reason(name, device)
            if reason is None:
                rasterizer = resolve(name, device)  # pyright: ignore[reportArgumentType]
                runnable.append(Contender(name, device, rasterizer))
            else:
                missing[name] = reason
    for contender in runnable:
        missing.pop(contender.name, None)
    return runnable, missing


@dataclass(frozen=True)
class Setting:
    """One position of all dials; a field that is not given has the registered methods' value."""

    dtype: torch.dtype = torch.float32
    cutoff: float = ALPHA_CUTOFF
    """Least alpha that is blended."""
    stop: float = TRANSMITTANCE_MIN
    """Transmittance at which blending ends."""
    antialiased: bool = False
    sh_degree: int = SH_DEGREE
    """Evaluated degree; all coefficients are carried along."""
    scale: float = 1.0
    """Factor of the picture's width and height."""


TODAY = Setting()
EXACT = Setting(torch.float64, cutoff=LEAST_ALPHA, stop=LEAST_TRANSMITTANCE)
SUPERSAMPLED = Setting(cutoff=LEAST_ALPHA, stop=LEAST_TRANSMITTANCE, antialiased=True, scale=4.0)

DIALS = {
    "alpha cutoff 1/32": Setting(cutoff=1 / 32),
    "alpha cutoff 1/64": Setting(cutoff=1 / 64),
    "alpha cutoff 1/1024": Setting(cutoff=1 / 1024),
    "early stop 1e-2": Setting(stop=1e-2),
    "early stop 1e-3": Setting(stop=1e-3),
    "early stop 1e-7": Setting(stop=LEAST_TRANSMITTANCE),
    "cutoff 1e-6, stop 1e-7": Setting(cutoff=LEAST_ALPHA, stop=LEAST_TRANSMITTANCE),
    "SH degree 0": Setting(sh_degree=0),
    "SH degree 1": Setting(sh_degree=1),
    "SH degree 2": Setting(sh_degree=2),
    "resolution 1/2": Setting(scale=1 / 2),
    "resolution 1/4": Setting(scale=1 / 4),
    "antialiasing": Setting(antialiased=True),
}
"""One dial at a time is turned away from `TODAY`."""

Replacement = tuple[ModuleType, str, Any]


def replacements(setting: Setting) -> list[Replacement]:
    """Module globals in which the `torch` and the `numba` backend keep their limits, with the
    setting's values. gsplat's limits are compiled in."""
    limits = Limits(np.float32(ALPHA_MAX), np.float32(setting.cutoff), np.float32(setting.stop))
    return [
        (projection, "REACH_SIGMAS", math.sqrt(2 * math.log(1 / setting.cutoff))),
        (torch_tiles, "ALPHA_CUTOFF", setting.cutoff),
        (torch_tiles, "TRANSMITTANCE_MIN", setting.stop),
        (numba_tiles, "ALPHA_CUTOFF", setting.cutoff),
        (numba_tiles, "_LIMITS", limits),
    ]


@contextmanager
def turned(setting: Setting) -> Iterator[None]:
    """Within, the backends of this process draw with the setting's limits. A backward pass reads
    them again, so it belongs within as well."""
    with ExitStack() as stack:
        for module, name, value in replacements(setting):
            stack.enter_context(mock.patch.object(module, name, value))
        yield


@dataclass(frozen=True)
class Drawn:
    """A picture and its gradients, float64 on the CPU."""

    picture: Float[Tensor, "H W 3"]
    gradients: dict[str, Tensor]
    """By parameter: of one fixed random weighting of all colours and alphas."""


@dataclass(frozen=True)
class Errors:
    """Distance of one drawing from the truth."""

    picture: float
    """RMSE of colours in [0, 1]."""
    gradient: float
    """|error| / |gradient| in L2 norms, of the parameter where that is largest. Norms and not the
    largest entries: a cutoff flips single pixels, and training follows all of them."""
    worst: str
    """That parameter."""


class Drawing:
    """A scene as one contender draws it with one setting: RGB and alpha, as training does."""

    def __init__(self, contender: Contender, scene: Scene, setting: Setting = TODAY) -> None:
        self.device, self.setting = contender.device, setting
        splats = scene.splats(setting.dtype, contender.device)
        self.splats = replace(splats, sh_degree=setting.sh_degree)
        self._size = (scene.view.height, scene.view.width)
        self._view = view_for(scene.view, setting, contender.device)
        self._settings = RenderSettings(antialiased=setting.antialiased)
        self._rasterizer = contender.rasterizer

    def _images(self) -> list[Tensor]:
        drawn: Rendering = self._rasterizer(self.splats, self._view, self._settings)
        return [drawn.rgb, drawn.alpha]

    def drawn(self) -> Drawn:
        """The picture in the scene's size, and its gradients."""
        with turned(self.setting):
            images = [resized(image, self._size) for image in self._images()]
            gradients = torch.autograd.grad(images, tensors_of(self.splats), cotangents(images))
        return Drawn(_exact(images[0]), dict(zip(PARAMETERS, map(_exact, gradients), strict=True)))

    def timed(self) -> tuple[Callable[[], None], Callable[[], None]]:
        """Two calls to time: forward without gradients, and forward + backward, each of the picture
        in the setting's own size and finished on the device."""
        with torch.no_grad(), turned(self.setting):
            factors = cotangents(self._images())

        def forward() -> None:
            with torch.no_grad(), turned(self.setting):
                self._images()
            self._wait()

        def both() -> None:
            with turned(self.setting):
                torch.autograd.grad(self._images(), tensors_of(self.splats), factors)
            self._wait()

        return forward, both

    def _wait(self) -> None:
        if self.device == "cuda":
            torch.cuda.synchronize()


def view_for(view: View, setting: Setting, device: str) -> View:
    """The same field of view in `scale` times the width and the height, a pixel at least; matrices
    in the setting's dtype on the device."""
    width, height = (max(1, round(setting.scale * side)) for side in (view.width, view.height))
    factors = view.K.new_tensor([width / view.width, height / view.height, 1.0])
    viewmat, K = (t.to(device, setting.dtype) for t in (view.viewmat, factors[:, None] * view.K))
    return View(viewmat, K, width, height)


def resized(
    image: Float[Tensor, "h w C"], size: tuple[int, int]
) -> Float[Tensor, "height width C"]:
    """The image in `size`, (height, width): bilinear enlarging, area means for reducing."""
    if image.shape[:2] == size:
        return image
    mode = "area" if image.shape[0] > size[0] else "bilinear"
    planes = torch.nn.functional.interpolate(image.permute(2, 0, 1)[None], size, mode=mode)
    return planes[0].permute(1, 2, 0)


def cotangents(images: list[Tensor]) -> list[Tensor]:
    """Fixed random gradients for images, in [0, 1)."""
    rng = torch.Generator().manual_seed(0)
    return [torch.rand(image.shape, generator=rng).to(image) for image in images]


def errors_of(drawn: Drawn, truth: Drawn) -> Errors:
    """How far `drawn` is from the truth."""
    off = {
        name: relative_norm(drawn.gradients[name], wanted)
        for name, wanted in truth.gradients.items()
    }
    worst = max(off, key=lambda name: off[name])
    error = drawn.picture - truth.picture
    return Errors(float(error.square().mean().sqrt()), off[worst], worst)


def relative_norm(actual: Tensor, wanted: Tensor) -> float:
    """|actual - wanted| / |wanted| in L2 norms; 0 where both are 0 throughout."""
    off = (actual - wanted).norm()
    return float(off / wanted.norm()) if off > 0 else 0.0


def _exact(tensor: Tensor) -> Tensor:
    return tensor.detach().cpu().double()
