"""How far each contender's float32 is from float64.

The reference is the `torch` backend in float64 on the same float32 numbers. Rounding may decide
whether a Gaussian is just above or just below the cutoff at a pixel (or just before or behind the
end of blending), which moves that pixel by up to 1/255 of a colour. Such flips are legal, rare and
no measure of precision: pixels that are off by more than FLIP count as flipped, at most
FLIP_BUDGET of all may be, and the loss whose gradients are compared leaves them out.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from desplat_ns.backend import resolve
from desplat_ns.calibration.scenes import PARAMETERS, Scene, tensors_of
from lab.pixels.contenders import Contender, cotangents, images_of
from lab.pixels.rasterizing import SETTINGS

FLIP = 2e-4
"""In colours from 0 to 1. The mean of a Gaussian, a sum and a quotient, is off by about one and a
half units in the last place of the picture's width, 6e-5 pixels for up to 1023. One sigma from its
mean a Gaussian changes by 1 / sigma of itself over a pixel, and the low-pass keeps sigma above
0.55: 1.5 x 6e-5 / 0.55 = 1.7e-4 if such a Gaussian were all of the pixel, for weights sum to 1."""

FLIP_BUDGET = 5e-4
"""Share of pixels. A pixel looks at some 60 Gaussians, whose log(alpha) is spread over about 6: 10
per unit. At the cutoff (3.3 sigma; typically 2 pixels each) log(alpha) is off by 3.3 / 2 x 3e-5:
10 x 5e-5 flips a pixel, most of which are too faint to see."""


@dataclass(frozen=True)
class Errors:
    """Of one contender on one scene."""

    scene: str
    contender: str
    largest: float
    """Of all pixels' RGB, flipped ones included."""
    largest_unflipped: float
    flipped: float
    """Share of pixels that are off by more than FLIP."""
    gradients: dict[str, float]
    """Largest error over largest gradient, by parameter, of a loss without the flipped pixels."""


def measure_errors(scene: Scene, contenders: list[Contender]) -> list[Errors]:
    """Compare every contender with float64."""
    exact = scene.splats(torch.float64)
    rendering = resolve("torch", "cpu")(exact, scene.view_as(torch.float64), SETTINGS)
    reference = images_of(rendering)
    errors = []
    for contender in contenders:
        splats, view = scene.splats(device=contender.device), scene.view_as(device=contender.device)
        images = images_of(contender.rasterizer(splats, view, SETTINGS))
        off = _differences(images, reference)
        steady = off <= FLIP
        factors = _loss_factors(reference, steady)
        grads = _gradients(images, tensors_of(splats), factors)
        exact_grads = _gradients(reference, tensors_of(exact), factors)
        errors.append(
            Errors(
                scene.name,
                contender.name,
                float(off.max()),
                float(off[steady].max()),
                float((~steady).double().mean()),
                {
                    name: _relative(grad, wanted)
                    for name, grad, wanted in zip(PARAMETERS, grads, exact_grads, strict=True)
                },
            )
        )
    return errors


@torch.no_grad()
def _differences(images: list[Tensor], reference: list[Tensor]) -> Tensor:
    """Largest difference in colour or alpha at each pixel, [H, W]."""
    pairs = zip(images[:2], reference[:2], strict=True)
    off = [(image.cpu().double() - exact).abs().amax(-1) for image, exact in pairs]
    return torch.maximum(*off)


@torch.no_grad()
def _loss_factors(reference: list[Tensor], steady: Tensor) -> list[Tensor]:
    """Random gradients of rgb, alpha and depth, 0 at flipped pixels.

    That of depth is weighted by alpha: depth is a quotient that means nothing where nothing is.
    """
    factors = [factor * steady[..., None] for factor in cotangents(reference)]
    return [*factors[:2], factors[2] * reference[1]]


def _gradients(images: list[Tensor], leaves: list[Tensor], factors: list[Tensor]) -> list[Tensor]:
    matching = [factor.to(image) for factor, image in zip(factors, images, strict=True)]
    return list(torch.autograd.grad(images, leaves, matching, retain_graph=True))


def _relative(measured: Tensor, wanted: Tensor) -> float:
    return float((measured.cpu().double() - wanted).abs().max() / wanted.abs().max())
