"""Formulas under poisoned values of their domain: everything that comes out has to be finite."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import Tensor

from desplat_ns import losses
from desplat_ns.backend import View
from desplat_ns.backend.ssim import ssim
from desplat_ns.gaussians.activation import activate_distractors, clamp_colors, sigmoid
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import distractors_at
from desplat_ns.gaussians.memory import GaussianMemory
from desplat_ns.photo_tourism import appearance, background
from desplat_ns.rendering import compositing, metrics
from desplat_ns.separation import placement as separation
from desplat_ns.separation import residuals as excess
from desplat_ns.separation.regions import outlier_regions
from lab.stability.fuzz_files import tensors_of
from tests.stability.poison import POISON

H, W = 13, 15
FINITE = tuple(v for v in POISON if abs(v) < torch.inf)
UNIT = tuple(v for v in FINITE if 0 <= v <= 1)
"""Of the poisons, what a colour or an opacity may be: zeros, denormals, thresholds, 1."""
MODERATE = tuple(v for v in FINITE if abs(v) <= 1e10)
"""What a raw parameter may be before its products leave float32."""


def poisoned(rng: random.Random, values: tuple[float, ...], *shape: int) -> Tensor:
    """Ordinary numbers in [0, 1], of which a random share is replaced by `values`."""
    noise = torch.rand(shape, generator=torch.Generator().manual_seed(rng.getrandbits(32)))
    flat, share = noise.flatten(), rng.choice([0.01, 0.3, 1.0])
    for i in range(flat.numel()):
        if rng.random() < share:
            flat[i] = rng.choice(values)
    return flat.reshape(shape)


@dataclass(frozen=True)
class Formula:
    """A function and the values that its arguments may have."""

    name: str
    call: Callable[..., Any]
    arguments: tuple[tuple[tuple[float, ...], tuple[int, ...]], ...]
    """Values and shape of each."""

    def attempt(self, rng: random.Random) -> list[str]:
        """What is wrong with values and gradients for one draw; nothing, if all is well."""
        inputs = [poisoned(rng, values, *shape) for values, shape in self.arguments]
        for tensor in inputs:
            tensor.requires_grad_()
        results = [r for r in tensors_of(self.call(*inputs)) if r.is_floating_point()]
        faults = [f"{self.name} is not finite" for r in results if not bool(r.isfinite().all())]
        smooth = [r.sum() for r in results if r.requires_grad]
        if smooth and not faults:
            grads = torch.autograd.grad(torch.stack(smooth).sum(), inputs, allow_unused=True)
            for i, grad in enumerate(grads):
                if grad is not None and not bool(grad.isfinite().all()):
                    faults.append(f"{self.name}: the gradient of argument {i} is not finite")
        return faults


VIEW = View(torch.eye(4), torch.tensor([[20.0, 0, 7], [0, 20, 6], [0, 0, 1]]), W, H)
IMAGE, PLANE, GRID = (UNIT, (H, W, 3)), (UNIT, (H, W, 1)), (4, 5)
COLORS = UNIT, (3, 8, 10)
"""Of the finer cells of `GRID`."""


def _excess(residual: Tensor, means2d: Tensor, opacities: Tensor) -> Tensor:
    stats = excess.ResidualStats.of(GaussianMemory({}), len(means2d), 1, residual.device)
    visible = means2d.isfinite().all(-1)
    residual = residual.detach().clamp(min=excess.MIN_RESIDUAL)
    for _ in range(3):
        rest = visible, opacities.detach(), stats
        result, stats = excess.excess_residual(residual, means2d.detach(), *rest)
    return torch.stack([result.values.sum(), stats.usual.sum(), stats.times_seen.sum()])


def _placed(means: Tensor) -> Tensor:
    regions = torch.ones(GRID, dtype=torch.bool)
    return separation.lie_in(regions, means, VIEW).float()


def _weighted(alpha: Tensor, cells: Tensor) -> Tensor:
    return separation.distractor_weight(alpha, cells.detach())


def _activated(means: Tensor, scales: Tensor, quats: Tensor, rgbs: Tensor, logits: Tensor) -> Any:
    raw = {"means": means, "scales": scales, "quats": quats, "rgbs": rgbs, "opacities": logits}
    splats = activate_distractors(raw)
    return [splats.means, splats.scales, splats.quats, splats.colors, splats.opacities]


def _regions(cells: Tensor) -> Tensor:
    return outlier_regions(cells > 0.04, cells > 0.25).float()


def _new_distractors(pixels: Tensor, rgbs: Tensor) -> dict[str, Tensor]:
    return distractors_at(VIEW, DistractorConfig(), pixels, rgbs)


def _free(alpha: Tensor, cells: Tensor) -> Tensor:
    return losses.distractor_opacity_loss(alpha, (cells > 0.5).to(alpha))


def _background_opacity(alpha_d: Tensor, alpha_s: Tensor, sky: Tensor, photo: Tensor) -> Tensor:
    explained = background.explained_by_background(sky, photo, 0.003)
    return background.background_opacity_loss(alpha_d, alpha_s, explained)


def _background_image(coefficients: Tensor) -> Tensor:
    return background.background_image(coefficients, VIEW, 4)


def _baked(coefficients: Tensor, gamma: Tensor, beta: Tensor) -> Tensor:
    return appearance.toned_coefficients(coefficients, gamma, beta)


FORMULAS = (
    Formula("composite_color", compositing.composite_color, (IMAGE, PLANE, IMAGE)),
    Formula("composite_alpha", compositing.composite_alpha, (PLANE, PLANE)),
    Formula("over_background", compositing.over_background, (IMAGE, PLANE, (UNIT, (3,)))),
    Formula("distractor_opacity_loss", _free, (PLANE, PLANE)),
    Formula("static_transparency_loss", losses.static_transparency_loss, (PLANE,)),
    Formula(
        "photometric_loss",
        lambda x, y, owned: losses.photometric_loss(x, y.detach(), 0.2, owned.detach()),
        (IMAGE, IMAGE, PLANE),
    ),
    Formula("ssim (training)", lambda x, y: ssim(x, y.detach()), (IMAGE, IMAGE)),
    Formula("ssim (metric)", lambda x, y: metrics.ssim(x.detach(), y.detach()), (IMAGE, IMAGE)),
    Formula("psnr", lambda x, y: metrics.psnr(x.detach(), y.detach()), (IMAGE, IMAGE)),
    Formula(
        "image_metrics",
        lambda x, y: metrics.image_metrics(x.detach(), y.detach()),
        ((FINITE, (H, W, 3)), IMAGE),
    ),
    Formula(
        "mean_alpha_outside",
        lambda a, m: metrics.mean_alpha_outside(a.detach(), m > 0.5),
        (PLANE, PLANE),
    ),
    Formula("local_residual", partial(excess.local_residual, grid=(5, 4)), (COLORS, COLORS)),
    Formula("ExpectedResidual", _excess, ((UNIT, GRID), (POISON, (9, 2)), (UNIT, (9,)))),
    Formula("outlier_regions", _regions, ((POISON, GRID),)),
    Formula("distractor_weight", _weighted, (PLANE, PLANE)),
    Formula("lie_in", _placed, ((POISON, (9, 3)),)),
    Formula("distractors_at", _new_distractors, ((MODERATE, (9, 2)), (UNIT, (9, 3)))),
    Formula(
        "activate_distractors",
        _activated,
        tuple((FINITE, shape) for shape in ((4, 3), (4, 3), (4, 4), (4, 3), (4, 1))),
    ),
    Formula("sigmoid", sigmoid, ((FINITE, (9,)),)),
    Formula("clamp_colors", clamp_colors, ((FINITE, (9, 3)),)),
    Formula(
        "toned_coefficients",
        _baked,
        ((MODERATE, (9, 4, 3)), (MODERATE, (9, 3)), (MODERATE, (9, 3))),
    ),
    Formula(
        "fourier_features", partial(appearance.fourier_features, frequencies=4), ((FINITE, (9, 3)),)
    ),
    Formula("background_image", _background_image, ((MODERATE, (25, 3)),)),
    Formula("background_opacity_loss", _background_opacity, (PLANE, PLANE, IMAGE, IMAGE)),
)
