"""What must hold for any scene, on every backend, and for the formulas behind them.

Two renderings of one truth may differ by both their bounds (docs/dev/stability.md), and by nothing
at all where no rounding differs.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from desplat_ns.backend import Rendering, RenderSettings
from desplat_ns.gaussians.activation import sigmoid
from desplat_ns.rendering.compositing import composite_alpha, composite_color, over_background
from tests.backend.scenes import (
    BACKENDS,
    PARAMETERS,
    Backend,
    TestScene,
    joined,
    make_backend,
    random_scene,
)
from tests.stability.bounds import error_bounds
from tests.stability.cases import picked
from tests.stability.measure import features

few = settings(max_examples=8)
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


def hamilton(p: Tensor, q: Tensor) -> Tensor:
    """The product of quaternions p q."""
    w, x, y, z = p.unbind(-1)
    a, b, c, d = q.unbind(-1)
    return torch.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        dim=-1,
    )


def moved_rigidly(scene: TestScene, seed: int) -> TestScene:
    """Scene and camera, turned and shifted; worked out in float64."""
    rng = torch.Generator().manual_seed(seed)
    q = torch.nn.functional.normalize(torch.randn(4, generator=rng).double(), dim=0)
    shift = 4 * torch.randn(3, generator=rng).double()
    w, v = q[0], q[1:]
    axes = torch.eye(3).double()
    around = torch.linalg.cross(v.expand(3, 3), axes)
    turn = (axes + 2 * (w * around + torch.linalg.cross(v.expand(3, 3), around))).T
    back = torch.eye(4).double()
    back[:3, :3], back[:3, 3] = turn.T, -turn.T @ shift
    return replace(
        scene,
        means=scene.means.double() @ turn.T + shift,
        quats=hamilton(q.expand_as(scene.quats), scene.quats.double()),
        viewmat=scene.viewmat.double() @ back,
    )


@few
@given(seed=seeds)
def test_a_rigid_motion_of_scene_and_camera_does_not_matter(backend, seed):
    scene = scene_of(seed)
    other = moved_rigidly(scene, seed)
    image, _ = drawn(backend, scene)
    again, _ = drawn(backend, other)
    check_same(backend, scene, other, again, image)


@few
@given(seed=seeds, power=st.integers(-6, 6))
def test_scaling_the_scene_changes_no_bit_of_colour(backend, seed, power):
    scene, factor = scene_of(seed), 2.0**power
    viewmat = scene.viewmat.clone()
    viewmat[:3, 3] *= factor
    other = replace(
        scene, means=scene.means * factor, scales=scene.scales * factor, viewmat=viewmat
    )
    image, _ = drawn(backend, scene)
    again, _ = drawn(backend, other)
    assert torch.equal(again[:, :4], image[:, :4])
    assert torch.equal(again[:, 4], image[:, 4] * factor)


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


@few
@given(seed=seeds, at=st.integers(0, 8), value=st.sampled_from([0.0, -0.0, 1e-40, 0.0039]))
def test_a_gaussian_below_the_cutoff_changes_nothing(backend, seed, at, value):
    """Nothing that one behind the camera would not."""
    scene = scene_of(seed)
    faint = replace(picked(scene_of(seed + 1), [0]), opacities=torch.tensor([value]))
    away = scene.viewmat[:3, :3].T @ (torch.tensor([0.0, 0, -5]) - scene.viewmat[:3, 3])
    culled = replace(picked(scene, [0]), means=away[None])
    rows = [*range(at), 8, *range(at, 8)]
    image, gradients = drawn(backend, picked(joined(scene, culled), rows))
    again, others = drawn(backend, picked(joined(scene, faint), rows))
    assert torch.equal(image, again)
    for name in PARAMETERS:
        assert torch.equal(others[name], gradients[name]), name
        assert (others[name][at] == 0).all(), name


unit = st.floats(0, 1)


@settings(few, max_examples=50)
@given(values=st.lists(unit, min_size=6, max_size=6))
def test_compositing_is_associative(values):
    """Distractors over the (scene over the background) = (distractors over the scene) over it."""
    a_d, a_s, c_d, c_s, background = (torch.tensor(v).double().expand(1, 1, 1) for v in values[:5])
    rgb_d, rgb_s = (c * a * torch.ones(1, 1, 3).double() for c, a in ((c_d, a_d), (c_s, a_s)))
    sky = background.expand(1, 1, 3)
    ours = over_background(composite_color(rgb_d, a_d, rgb_s), composite_alpha(a_d, a_s), sky)
    other = over_background(rgb_d, a_d, over_background(rgb_s, a_s, sky))
    # Each side rounds 8 numbers of at most 1.
    assert ((ours - other).abs() <= 16 * torch.finfo(torch.float64).eps / 2).all()


@settings(few, max_examples=50)
@given(x=st.floats(-(2.0**100), 2.0**100, width=32), step=st.floats(0, 1e3, width=32))
def test_a_sigmoid_is_in_range_monotonous_and_symmetric(x, step):
    low, high, mirrored = sigmoid(torch.tensor([x, x + step, -x]))
    assert 0 <= low <= 1
    assert high >= low
    # Each side rounds exp, a sum and a quotient.
    assert abs(1 - low.item() - mirrored.item()) <= 4 * torch.finfo(torch.float32).eps


def test_the_rendering_of_a_property_is_not_empty(backend):
    """Else every property above would hold of nothing."""
    _, got = backend.render(scene_of(0), RenderSettings())
    assert isinstance(got, Rendering)
    assert got.alpha.mean() > 0.2
