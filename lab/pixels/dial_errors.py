"""A scene drawn with one setting of the dials, and how far its picture and gradients are off.

The truth of all dials that approximate is one: the `torch` backend in float64 with limits so low
that they cost what float32 rounds away (`dials.EXACT`). It is of full size and of all degrees of
the harmonics; smaller pictures are resized up to it, and gradients are pulled back through that.
The low-pass of 0.3 pixels^2 and the clamp of alpha are no dials: the truth has them, too.

Antialiasing does not approximate that truth. It asks what a pixel should show where Gaussians are
smaller than the low-pass, and its truth is the mean over 16 samples in each pixel
(`dials.SUPERSAMPLED`), so that it is no point on the same axis. Both truths are about these
Gaussians: a capture that is trained with a setting adapts to it, and may lose less than it says
here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.calibration.scenes import PARAMETERS, Scene, tensors_of
from desplat_ns.rendering.metrics import psnr
from lab.pixels.contenders import Contender, cotangents, images_of
from lab.pixels.dials import Setting, replacements, turned
from lab.pixels.rasterizing import Cases, forward_and_both

LeavesOf = Callable[[torch.dtype, str], Splats]
"""The scene's Gaussians by dtype and device, the same tensors for all settings."""


@dataclass(frozen=True)
class Drawn:
    """What is compared, float64 on the CPU."""

    picture: Tensor
    """Colours from 0 to 1 where nothing shines brighter: RGB [H, W, 3], or any other shape."""
    gradients: dict[str, Tensor]
    """By each parameter, of one fixed random weighting of all colours (and of alpha)."""


@dataclass(frozen=True)
class DialErrors:
    """Of one drawing against the truth."""

    picture: float
    """RMSE of colours from 0 to 1."""
    psnr: float
    """dB, at most `metrics.PSNR_MAX`."""
    gradient: float
    """Norm of the error over the norm of the gradient, of the parameter where that is largest.

    By parameter, since each is of a unit of its own and Adam divides each by its own size. Norms
    (L2) and not the largest entries: a cutoff flips single pixels, of which one Gaussian in
    thousands learns something else, while training follows all of them."""
    worst: str
    """That parameter."""


class Drawing:
    """A scene as one contender draws it with one setting: RGB and alpha, as training does."""

    def __init__(
        self, contender: Contender, scene: Scene, setting: Setting, leaves: LeavesOf
    ) -> None:
        self.contender, self.setting = contender, setting
        self.size = (scene.view.height, scene.view.width)
        self.splats = replace(leaves(setting.dtype, contender.device), sh_degree=setting.sh_degree)
        self.view = scaled_view(scene.view_as(setting.dtype, contender.device), setting.scale)
        self.settings = RenderSettings(antialiased=setting.antialiased)
        self._replacements = replacements(contender, setting)

    def _render(self):
        return self.contender.rasterizer(self.splats, self.view, self.settings)

    def timed(self) -> Cases:
        """Forward, and forward + backward, of the picture in its own size."""
        with turned(self._replacements):
            forward, both = forward_and_both(
                self._render, tensors_of(self.splats), self.contender.device
            )
        return self._turned(forward), self._turned(both)

    def _turned(self, call: Callable[[], object]) -> Callable[[], None]:
        def within() -> None:
            with turned(self._replacements):
                call()

        return within

    def drawn(self) -> Drawn:
        """The picture in the scene's size, and its gradients."""
        with turned(self._replacements):
            images = [resized(image, self.size) for image in images_of(self._render())]
            gradients = torch.autograd.grad(images, tensors_of(self.splats), cotangents(images))
        return Drawn(_exact(images[0]), dict(zip(PARAMETERS, map(_exact, gradients), strict=True)))


def scaled_view(view: View, scale: float) -> View:
    """The same field of view in `scale` times the width and the height, a pixel at least."""
    width, height = (max(1, round(scale * side)) for side in (view.width, view.height))
    factors = view.K.new_tensor([width / view.width, height / view.height, 1.0])
    return View(view.viewmat, factors[:, None] * view.K, width, height)


def resized(
    image: Float[Tensor, "h w C"], size: tuple[int, int]
) -> Float[Tensor, "height width C"]:
    """The image in `size`, (height, width): bilinear where that is more, means where it is less."""
    if image.shape[:2] == size:
        return image
    planes = image.permute(2, 0, 1)[None]
    if image.shape[0] > size[0]:
        planes = torch.nn.functional.interpolate(planes, size, mode="area")
    else:
        planes = torch.nn.functional.interpolate(planes, size, mode="bilinear")
    return planes[0].permute(1, 2, 0)


def errors_of(drawn: Drawn, truth: Drawn) -> DialErrors:
    """How far `drawn` is off."""
    off = {
        name: relative_norm(drawn.gradients[name], wanted)
        for name, wanted in truth.gradients.items()
    }
    worst = max(off, key=lambda name: off[name])
    rmse = (drawn.picture - truth.picture).square().mean().sqrt()
    return DialErrors(float(rmse), psnr(drawn.picture, truth.picture), off[worst], worst)


def relative_norm(actual: Tensor, wanted: Tensor) -> float:
    """|actual - wanted| / |wanted|, L2; 0 where both are 0 throughout."""
    off = (actual - wanted).norm()
    return float(off / wanted.norm()) if off > 0 else 0.0


def _exact(tensor: Tensor) -> Tensor:
    return tensor.detach().cpu().double()
