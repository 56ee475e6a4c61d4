"""What must hold for any scene, on every backend: sound ones are drawn alike in any order, poisoned
ones are culled or refused and spoil nothing.

Two renderings of one truth may differ by both their bounds (docs/dev/stability.md), and by nothing
at all where no rounding differs.
"""

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from desplat_ns.backend import RenderSettings
from desplat_ns.layers import composite_alpha, over_background
from tests.backend.scenes import (
    EXACT_BACKENDS,
    PARAMETERS,
    Backend,
    TestScene,
    joined,
    make_backend,
    picked,
    random_scene,
)
from tests.stability.bounds import error_bounds
from tests.stability.cases import hard, witness
from tests.stability.measure import features

few = settings(max_examples=5)
seeds = st.integers(0, 10_000)
DEPTH = RenderSettings(depth=True)

POISON = (
    math.nan, math.inf, -math.inf, 0.0, -0.0, 1e-45, -1e-45, 1.2e-38, 1e-30, 1e-20, 1e-12, 1e-6,
    1 / 255, 0.999, 1.0, -1.0, 1e-4, 0.01, 1e4, 1e8, 1e10, 1e18, 1.9e19, 1e38, -1e38, 3.4e38,
)  # fmt: skip
"""Not numbers, infinities, zeros, denormals, the exact thresholds, powers that overflow."""

CAMERA = ("viewmat", "K")

Doses = list[tuple[str, int, int, float]]
"""A parameter or a matrix of the camera, a Gaussian, a component, and the value put there."""


@pytest.fixture(
    params=[p for p in EXACT_BACKENDS if p.id != "torch-float64"],  # the same code as in float32
    scope="module",
)
def backend(request: pytest.FixtureRequest) -> Backend:
    return make_backend(*request.param)


def scene_of(seed: int, count: int = 8) -> TestScene:
    return random_scene(seed, count=count, size=(13, 9), opacity=(0.05, 0.7))


def drawn(backend: Backend, scene: TestScene) -> tuple[Tensor, dict[str, Tensor]]:
    """Features [P, F] and gradients of their weighted sum, by parameter."""
    leaves, got = backend.render(scene, DEPTH)
    image = features(got)
    rng = torch.Generator().manual_seed(1)
    (image * torch.rand(image.shape, generator=rng).to(image)).sum().backward()
    return image.detach().cpu(), {name: getattr(leaves, name).grad.cpu() for name in PARAMETERS}


def check_same(backend: Backend, scene: TestScene, got: Tensor, want: Tensor) -> None:
    """Two renderings of a scene are equal within twice its bound, wherever it does not lie within
    rounding of a jump."""
    factor = torch.zeros(len(got), 5, dtype=torch.float64)
    bounds = error_bounds(scene.to(torch.float64), DEPTH, backend.dtype, factor)
    assert bounds.safe.double().mean() > 0.8
    assert want.abs().amax() > 0.01
    assert ((got.double() - want.double()).abs() <= 2 * bounds.values)[bounds.safe].all()


@few
@given(seed=seeds)
def test_the_order_of_gaussians_does_not_matter(backend, seed):
    scene = scene_of(seed)
    order = torch.randperm(8, generator=torch.Generator().manual_seed(seed))
    image, gradients = drawn(backend, scene)
    again, shuffled = drawn(backend, picked(scene, order))
    if backend.name == "numba":  # works on whole batches; how torch rounds a row is up to its place
        assert torch.equal(image, again)
    check_same(backend, scene, again, image)
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
    rgb = over_background(d.rgb, d.alpha, s.rgb)
    alpha = composite_alpha(d.alpha, s.alpha)
    image, _ = drawn(backend, scene)
    got = torch.cat([rgb, alpha], dim=-1).reshape(-1, 4).detach().cpu()
    check_same(backend, scene, torch.cat([got, image[:, 4:]], dim=-1), image)


def healthy(sh_degree: int | None) -> TestScene:
    """Four ordinary Gaussians one behind the other; 3 x 3 colour coefficients with SH."""
    scene = joined(joined(hard(), witness(2.5)), joined(witness(), witness(4.0)))
    if sh_degree is None:
        return scene
    rng = torch.Generator().manual_seed(1)
    return replace(scene, colors=torch.rand(4, 4, 3, generator=rng) - 0.3, sh_degree=sh_degree)


def poisoned(scene: TestScene, doses: Doses) -> TestScene:
    """The scene with all doses in it."""
    changed = {n: getattr(scene, n).clone() for n in (*PARAMETERS, *CAMERA)}
    for into, gaussian, component, value in doses:
        row = (changed[into] if into in CAMERA else changed[into][gaussian]).view(-1)
        row[component % len(row)] = value
    return replace(scene, **changed)


def check_spoils_nothing(
    backend: Backend, scene: TestScene, settings: RenderSettings = DEPTH
) -> None:
    """Whatever is drawn is finite; what is culled has no gradient, and leaves the image as it is
    without it."""
    leaves, got = backend.render(scene, settings)
    image = features(got)
    image.sum().backward()
    assert image.isfinite().all()
    culled = (got.radii == 0).cpu()
    for name in PARAMETERS:
        gradient = getattr(leaves, name).grad
        assert gradient.isfinite().all(), name
        assert gradient[culled].abs().sum() == 0, name
        assert getattr(scene, name)[~culled].isfinite().all(), name
    kept = {name: getattr(scene, name)[~culled] for name in PARAMETERS}
    without = features(backend.render(replace(scene, **kept), settings)[1])
    assert torch.equal(image, without)


def doses(into: tuple[str, ...], most: int) -> st.SearchStrategy[Doses]:
    dose = st.tuples(
        st.sampled_from(into), st.integers(0, 2), st.integers(0, 15), st.sampled_from(POISON)
    )
    return st.lists(dose, min_size=1, max_size=most)


@settings(max_examples=30)
@given(given_doses=doses(PARAMETERS, 4), sh=st.sampled_from([None, 1]), antialiased=st.booleans())
def test_poisoned_gaussians_are_culled_and_spoil_nothing(backend, given_doses, sh, antialiased):
    scene = healthy(sh)
    assert (backend.render(scene, RenderSettings())[1].radii > 0).all()  # there is what to spoil
    settings = RenderSettings(depth=True, absgrad=True, antialiased=antialiased)
    check_spoils_nothing(backend, poisoned(scene, given_doses), settings)


@settings(max_examples=20)
@given(given_doses=doses((*PARAMETERS, *CAMERA), 3))
def test_a_poisoned_camera_is_refused_or_harmless(backend, given_doses):
    try:
        check_spoils_nothing(backend, poisoned(healthy(None), given_doses))
    except ValueError as error:
        assert any(name in str(error) for name in CAMERA)
