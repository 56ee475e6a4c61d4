"""Poisoned inputs: an error that says what is wrong, or culled, and nothing else spoiled."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from desplat_ns.backend import RenderSettings
from tests.backend.scenes import BACKENDS, Backend, make_backend
from tests.stability.poison import CAMERA, PLACES, POISON, Dose, give, healthy

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


@pytest.mark.slow
@settings(max_examples=60)
@given(given_doses=doses(parameters, 4), sh=st.sampled_from([None, 1]), antialiased=st.booleans())
def test_poisoned_gaussians_are_culled_and_spoil_nothing(backend, given_doses, sh, antialiased):
    fate = give(backend, given_doses, sh, antialiased)
    assert not fate.refused
    assert not fate.faults


@settings(max_examples=30)
@given(given_doses=doses(anything, 3), antialiased=st.booleans())
def test_a_poisoned_camera_is_refused_or_harmless(backend, given_doses, antialiased):
    fate = give(backend, given_doses, None, antialiased)
    assert not fate.faults


@pytest.mark.parametrize("sh", [None, 1])
def test_the_healthy_scene_is_seen(backend, sh):
    """Else nothing that is poisoned could spoil it."""
    _, got = backend.render(healthy(sh), RenderSettings())
    assert (got.radii > 0).all()
    assert got.alpha.max() > 0.5


def test_every_kind_of_fault_would_be_found(backend, monkeypatch):
    """A rasterizer that draws NaN must not pass."""
    render = type(backend).render

    def spoiled(self, scene, options):
        leaves, got = render(self, scene, options)
        if len(scene.means) == 4:
            got = type(got)(**{**vars(got), "rgb": got.rgb + leaves.scales.sum() * torch.nan})
        return leaves, got

    monkeypatch.setattr(type(backend), "render", spoiled)
    fate = give(backend, [Dose("quats", 0, 0, 1.0)], None, False)
    assert len(fate.faults) == 3
