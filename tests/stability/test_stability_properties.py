"""What must hold for any scene, on every backend.

Two renderings of one truth may differ by both their bounds (docs/dev/stability.md), and by nothing
at all where no rounding differs.
"""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from desplat_ns.backend import Rendering, RenderSettings
from desplat_ns.rendering.layers import composite_alpha, composite_color
from tests.backend.scenes import (
    BACKENDS,
    PARAMETERS,
    Backend,
    TestScene,
    make_backend,
    random_scene,
)
from tests.stability.bounds import error_bounds
from tests.stability.cases import picked
from tests.stability.measure import features

few = settings(max_examples=5)
seeds = st.integers(0, 10_000)
SIZE = (13, 9)
DEPTH = RenderSettings(depth=True)

EXACT = [p for p in BACKENDS if p.id not in ("gsplat", "torch-float64")]
"""gsplat cuts opaque Gaussians off at 3 sigma, by design; torch in float64 is the same code."""


@pytest.fixture(params=EXACT, scope="module")
def backend(request: pytest.FixtureRequest) -> Backend:
    return make_backend(*request.param)


def scene_of(seed: int, count: int = 8, **options) -> TestScene:
    return random_scene(seed, count=count, size=SIZE, opacity=(0.05, 0.7), **options)


def drawn(backend: Backend, scene: TestScene, settings: RenderSettings = DEPTH):
    """Features [P, F] and gradients of their weighted sum, by parameter."""
    leaves, got = backend.render(scene, settings)
    image = features(got)
    rng = torch.Generator().manual_seed(1)
    (image * torch.rand(image.shape, generator=rng).to(image)).sum().backward()
    return image.detach().cpu(), {name: getattr(leaves, name).grad.cpu() for name in PARAMETERS}


def check_same(backend: Backend, first: TestScene, other: TestScene, got: Tensor, want: Tensor):
    """Equal within both bounds, wherever neither lies within rounding of a jump."""
    allowed, safe = torch.zeros_like(got, dtype=torch.float64), torch.ones(len(got)).bool()
    for scene in (first, other):
        factor = torch.zeros(len(got), 5, dtype=torch.float64)
        bounds = error_bounds(scene.to(torch.float64), DEPTH, backend.dtype, factor)
        allowed, safe = allowed + bounds.values, safe & bounds.safe
    assert safe.double().mean() > 0.8
    assert ((got.double() - want.double()).abs() <= allowed)[safe].all()


@few
@given(seed=seeds)
def test_the_order_of_gaussians_does_not_matter(backend, seed):
    scene = scene_of(seed)
    order = torch.randperm(8, generator=torch.Generator().manual_seed(seed))
    image, gradients = drawn(backend, scene)
    again, shuffled = drawn(backend, picked(scene, order))
    if backend.name == "numba":  # works on whole batches; how torch rounds a row is up to its place
        assert torch.equal(image, again)
    check_same(backend, scene, scene, again, image)
    # The torch backend adds a tile's gradients up in another order.
    many = 64 * torch.finfo(backend.dtype).eps
    for name in PARAMETERS:
        off = (gradients[name][order] - shuffled[name]).abs().max()
        assert off <= many * gradients[name].abs().max(), name


@few
@given(seed=seeds)
def test_the_composite_is_one_rasterization_with_the_distractors_in_front(backend, seed):
    """While blending stops in neither: four layers of 0.7 leave 0.008."""
    scene = scene_of(seed, count=4)
    depth = scene.means @ scene.viewmat[2, :3] + scene.viewmat[2, 3]
    order = depth.argsort()
    front, behind = picked(scene, order[:2]), picked(scene, order[2:])
    (_, d), (_, s) = (backend.render(part, RenderSettings()) for part in (front, behind))
    rgb = composite_color(d.rgb, d.alpha, s.rgb)
    alpha = composite_alpha(d.alpha, s.alpha)
    image, _ = drawn(backend, scene)
    got = torch.cat([rgb, alpha], dim=-1).reshape(-1, 4).detach().cpu()
    check_same(backend, scene, scene, torch.cat([got, image[:, 4:]], dim=-1), image)


def test_the_rendering_of_a_property_is_not_empty(backend):
    """Else every property above would hold of nothing."""
    _, got = backend.render(scene_of(0), RenderSettings())
    assert isinstance(got, Rendering)
    assert got.alpha.mean() > 0.2
