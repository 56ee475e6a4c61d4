"""Poisoned inputs: an error that says what is wrong, or culled, and nothing else spoiled."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from desplat_ns.backend import RenderSettings
from tests.backend.scenes import BACKENDS, PARAMETERS, Backend, TestScene, joined, make_backend
from tests.stability.cases import hard, witness
from tests.stability.measure import features

POISON = (
    math.nan, math.inf, -math.inf, 0.0, -0.0, 1e-45, -1e-45, 1.2e-38, 1e-30, 1e-20, 1e-12, 1e-6,
    1 / 255, 0.999, 1.0, -1.0, 1e-4, 0.01, 1e4, 1e8, 1e10, 1e18, 1.9e19, 1e38, -1e38, 3.4e38,
)  # fmt: skip
"""Not numbers, infinities, zeros, denormals, the exact thresholds, powers that overflow."""

PLACES = {"means": 3, "quats": 4, "scales": 3, "opacities": 1, "colors": 3}
CAMERA = ("viewmat", "K")


@dataclass(frozen=True)
class Dose:
    """One value put somewhere."""

    into: str
    """A parameter, "viewmat" or "K"."""
    gaussian: int
    component: int
    value: float


def healthy(sh_degree: int | None) -> TestScene:
    """Four ordinary Gaussians one behind the other; 3 x 3 colour coefficients with SH."""
    scene = joined(joined(hard(), witness(2.5)), joined(witness(), witness(4.0)))
    if sh_degree is None:
        return scene
    rng = torch.Generator().manual_seed(1)
    return replace(scene, colors=torch.rand(4, 4, 3, generator=rng) - 0.3, sh_degree=sh_degree)


def poisoned(scene: TestScene, doses: list[Dose]) -> TestScene:
    """The scene with all doses in it."""
    changed = {n: getattr(scene, n).clone() for n in (*PARAMETERS, *CAMERA)}
    for dose in doses:
        if dose.into in CAMERA:
            matrix = changed[dose.into]
            matrix.view(-1)[dose.component % matrix.numel()] = dose.value
        else:
            row = changed[dose.into][dose.gaussian].view(-1)
            row[dose.component % len(row)] = dose.value
    return replace(scene, **changed)


def faults_of(
    backend: Backend, doses: list[Dose], sh_degree: int | None, antialiased: bool
) -> list[str]:
    """Render a poisoned scene forwards and backwards, and look for what must never happen.

    Raises:
        ValueError: the scene is refused.
    """
    scene = poisoned(healthy(sh_degree), doses)
    settings = RenderSettings(depth=True, absgrad=True, antialiased=antialiased)
    leaves, got = backend.render(scene, settings)
    image = features(got)
    image.sum().backward()
    culled = (got.radii == 0).cpu()
    gradients = {name: getattr(leaves, name).grad for name in PARAMETERS}
    faults = []
    if not image.isfinite().all():
        faults.append("the image is not finite")
    for name, gradient in gradients.items():
        if not gradient.isfinite().all():
            faults.append(f"the gradient by {name} is not finite")
        if gradient[culled].abs().sum() != 0:
            faults.append(f"the gradient by {name} of what is culled is not 0")
    if not all(finite_rows(scene, i) for i in (~culled).nonzero()[:, 0].tolist()):
        faults.append("something that is not finite was drawn")
    if not torch.equal(image.detach(), without(backend, scene, culled, settings)):
        faults.append("what is culled changes the image")
    return faults


def finite_rows(scene: TestScene, i: int) -> bool:
    return all(bool(getattr(scene, name)[i].isfinite().all()) for name in PARAMETERS)


def without(backend: Backend, scene: TestScene, culled: Tensor, settings: RenderSettings) -> Tensor:
    """The image of the scene from which the culled Gaussians were taken away beforehand."""
    kept = {name: getattr(scene, name)[~culled] for name in PARAMETERS}
    return features(backend.render(replace(scene, **kept), settings)[1]).detach()


EXACT = [p for p in BACKENDS if p.id not in ("gsplat", "torch-float64")]

parameters = st.sampled_from(sorted(PLACES))
anything = st.sampled_from([*sorted(PLACES), *CAMERA])


def doses(where: st.SearchStrategy[str], most: int) -> st.SearchStrategy[list[Dose]]:
    places = st.integers(0, 15)
    dose = st.builds(Dose, where, st.integers(0, 2), places, st.sampled_from(POISON))
    return st.lists(dose, min_size=1, max_size=most)


@pytest.fixture(params=EXACT, scope="module")
def backend(request: pytest.FixtureRequest) -> Backend:
    return make_backend(*request.param)


@settings(max_examples=30)
@given(given_doses=doses(parameters, 4), sh=st.sampled_from([None, 1]), antialiased=st.booleans())
def test_poisoned_gaussians_are_culled_and_spoil_nothing(backend, given_doses, sh, antialiased):
    assert faults_of(backend, given_doses, sh, antialiased) == []


@settings(max_examples=20)
@given(given_doses=doses(anything, 3), antialiased=st.booleans())
def test_a_poisoned_camera_is_refused_or_harmless(backend, given_doses, antialiased):
    try:
        assert faults_of(backend, given_doses, None, antialiased) == []
    except ValueError as error:
        assert any(name in str(error) for name in CAMERA)


@pytest.mark.parametrize("sh", [None, 1])
def test_the_healthy_scene_is_seen(backend, sh):
    """Else nothing that is poisoned could spoil it."""
    _, got = backend.render(healthy(sh), RenderSettings())
    assert (got.radii > 0).all()
    assert got.alpha.max() > 0.5
