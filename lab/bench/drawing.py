"""A generated scene drawn by one backend, timed and compared with the `torch` backend's drawing in
float64."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend import Rasterizer, registry, resolve
from desplat_ns.backend.protocol import RenderSettings, View
from lab.bench.scenes import PARAMETERS, Scene, tensors_of


@dataclass(frozen=True)
class Contender:
    """A rasterizer, and the device on which it draws."""

    name: str
    device: str
    rasterizer: Rasterizer


def contenders() -> tuple[list[Contender], dict[str, str]]:
    """Every backend on every device type where it can run; the backends that run nowhere, each with
    the reason."""
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
    """A scene as one contender draws it: RGB and alpha, as training does."""

    def __init__(
        self, contender: Contender, scene: Scene, dtype: torch.dtype = torch.float32
    ) -> None:
        self.device = contender.device
        self._splats = scene.splats(dtype, contender.device)
        view = scene.view
        viewmat, K = (matrix.to(contender.device, dtype) for matrix in (view.viewmat, view.K))
        self._view = View(viewmat, K, view.width, view.height)
        self._rasterizer = contender.rasterizer

    def _images(self) -> list[Tensor]:
        drawn = self._rasterizer(self._splats, self._view, RenderSettings())
        return [drawn.rgb, drawn.alpha]

    def drawn(self) -> Drawn:
        """The picture and its gradients."""
        images = self._images()
        gradients = torch.autograd.grad(images, tensors_of(self._splats), cotangents(images))
        return Drawn(_exact(images[0]), dict(zip(PARAMETERS, map(_exact, gradients), strict=True)))

    def timed(self) -> tuple[Callable[[], None], Callable[[], None]]:
        """Two calls to time: forward without gradients, and forward + backward, each finished on
        the device."""
        with torch.no_grad():
            factors = cotangents(self._images())

        def forward() -> None:
            with torch.no_grad():
                self._images()
            self._wait()

        def both() -> None:
            torch.autograd.grad(self._images(), tensors_of(self._splats), factors)
            self._wait()

        return forward, both

    def _wait(self) -> None:
        if self.device == "cuda":
            torch.cuda.synchronize()


def cotangents(images: list[Tensor]) -> list[Tensor]:
    """Fixed random gradients for images, in [0, 1)."""
    rng = torch.Generator().manual_seed(0)
    return [torch.rand(image.shape, generator=rng).to(image) for image in images]


def errors_of(drawn: Drawn, truth: Drawn) -> Errors:
    """How far `drawn` is from the truth."""
    off = {
        name: float((drawn.gradients[name] - wanted).norm() / wanted.norm())
        for name, wanted in truth.gradients.items()
    }
    worst = max(off, key=lambda name: off[name])
    error = drawn.picture - truth.picture
    return Errors(float(error.square().mean().sqrt()), off[worst], worst)


def _exact(tensor: Tensor) -> Tensor:
    return tensor.detach().cpu().double()
