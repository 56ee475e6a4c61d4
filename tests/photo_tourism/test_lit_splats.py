"""Gaussians as one view shows them: the pictures and gradients of toning all coefficients."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.registry import resolve
from desplat_ns.core.effects import Effects
from desplat_ns.photo_tourism.config import AppearanceConfig
from desplat_ns.photo_tourism.image_effects import ImageEffects

NUM, FEATURES = 200, 24
SETTINGS = RenderSettings()
VIEW = View(torch.eye(4), torch.tensor([[30.0, 0, 16], [0, 30, 12], [0, 0, 1]]), 32, 24)


def effects_of(appearance: Any) -> Any:
    torch.manual_seed(0)
    built = ImageEffects(Effects(appearance=appearance), AppearanceConfig(), 3, 3)
    for parameter in built.parameters():
        parameter.data += 0.2 * torch.randn(parameter.shape)
    return built


def scene(has_harmonics: bool = True, dtype: torch.dtype = torch.float64) -> tuple[Splats, View]:
    """Gaussians all around; colours of which some are cut off at 0."""
    rng = torch.Generator().manual_seed(0)

    def leaf(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=rng).to(dtype)

    shape = (NUM, 16, 3) if has_harmonics else (NUM, 3)
    leaves = [2 * leaf(NUM, 3), leaf(NUM, 4), 0.2 * leaf(NUM, 3).exp(), leaf(NUM).sigmoid()]
    leaves = [t.requires_grad_() for t in (*leaves, 0.4 * leaf(*shape))]
    view = replace(VIEW, viewmat=VIEW.viewmat.to(dtype), K=VIEW.K.to(dtype))
    return Splats(*leaves, sh_degree=2 if has_harmonics else None), view


@pytest.mark.parametrize(
    ("appearance", "has_harmonics"), [("affine", True), ("affine", False), ("sh", True)]
)
def test_pictures_and_gradients_are_those_of_all_toned(appearance, has_harmonics):
    effects = effects_of(appearance).double()
    (splats, view), features = scene(has_harmonics), torch.randn(NUM, FEATURES).double()
    features.requires_grad_()
    embedding = effects.of(1)
    leaves = [*(getattr(splats, n) for n in ("means", "scales", "opacities", "colors")), features]
    leaves += [effects.embeddings, *effects.appearance.parameters()]
    results = []
    for lit in (
        effects.apply_appearance(splats, features, embedding),
        effects.appearance.in_view(splats, features, view)(embedding),
    ):
        image = resolve("torch", "cpu")(lit, view, SETTINGS).rgb
        weight = torch.linspace(-1, 1, image.numel()).double().view(image.shape)
        results.append([image, *torch.autograd.grad(image, leaves, weight)])
    for ours, theirs in zip(*results, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-9, atol=1e-12 * NUM)
    assert results[0][0].abs().max() > 0.1


def test_a_gaussian_of_broken_coefficients_is_culled_and_breaks_nothing():
    effects, (splats, view) = effects_of("affine"), scene(dtype=torch.float32)
    features = torch.randn(NUM, FEATURES, requires_grad=True)
    numba = resolve("numba", "cpu")
    lit = effects.appearance.in_view(splats, features, view)(effects.of(0))
    broken = int(numba(lit, view, SETTINGS).visible.nonzero()[0])
    with torch.no_grad():
        splats.colors[broken, 3] = float("nan")
    lit = effects.appearance.in_view(splats, features, view)(effects.of(0))
    drawn = numba(lit, view, SETTINGS)
    assert drawn.rgb.isfinite().all() and not drawn.visible[broken]
    leaves = [*effects.appearance.parameters(), splats.means, splats.colors]
    gradients = torch.autograd.grad(drawn.rgb.square().sum(), leaves)
    assert all(gradient.isfinite().all() for gradient in gradients)
