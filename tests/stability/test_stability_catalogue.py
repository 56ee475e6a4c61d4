"""Every case of the catalogue on every backend; docs/dev/stability.md derives the bounds."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.backend import RenderSettings, resolve
from desplat_ns.backend.inputs import is_finite
from desplat_ns.gaussians.activation import activate_static
from tests.backend.scenes import BACKENDS, Backend, make_backend
from tests.stability.cases import CASES, Case, hard
from tests.stability.formula_cases import FORMULA_CASES, FormulaCase
from tests.stability.measure import run

SAFE = 0.9
"""Least share of pixels that are compared; a case that leaves out more tests nothing."""

DTYPES = {"float32": torch.float32, "float64": torch.float64}


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Backend:
    made = make_backend(*request.param)
    if made.name == "gsplat":
        pytest.skip("gsplat cuts opaque Gaussians off at 3 sigma, by design")
    return made


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_hard_scene_is_finite_and_as_promised(backend: Backend, case: Case):
    outcome = run(case, backend)
    assert outcome.finite
    assert outcome.culled
    if case.exact_in_float32 == (backend.dtype == torch.float64):
        return  # float64 is the same code: it is compared where float32 cannot hold the scene
    assert outcome.drawn
    assert outcome.safe >= SAFE
    rounded = 2 if backend.dtype == torch.float64 else 1  # so is the reference
    assert outcome.value_share <= rounded
    assert outcome.gradient_share <= rounded


@pytest.mark.parametrize("dtype", DTYPES.values(), ids=list(DTYPES))
@pytest.mark.parametrize("case", FORMULA_CASES, ids=lambda case: case.name)
def test_a_hard_input_of_a_formula_is_finite_and_as_promised(case: FormulaCase, dtype):
    values, gradients = case.run(dtype)
    assert values.within, values
    assert gradients.within, gradients


def test_names_are_unique():
    names = [case.name for case in (*CASES, *FORMULA_CASES)]
    assert len(names) == len(set(names))


@pytest.mark.slow
def test_a_learning_rate_spike_leaves_everything_finite(backend: Backend):
    """One step far out, then two ordinary ones: what is lost is culled and counted."""
    rng = torch.Generator().manual_seed(2)
    raw = {
        "means": torch.cat([torch.rand(20, 2, generator=rng) - 0.5, torch.full((20, 1), 2.0)], -1),
        "scales": torch.full((20, 3), -2.0),
        "quats": torch.randn(20, 4, generator=rng),
        "features_dc": torch.rand(20, 3, generator=rng),
        "features_rest": 0.1 * torch.randn(20, 3, 3, generator=rng),
        "opacities": torch.randn(20, 1, generator=rng),
    }
    raw = {k: v.to(backend.device, backend.dtype).requires_grad_() for k, v in raw.items()}
    adam = torch.optim.Adam(raw.values())
    view = hard().to(backend.dtype, backend.device).view
    for step in range(3):
        adam.param_groups[0]["lr"] = 1e6 if step == 0 else 1e-3
        splats = activate_static(raw, 1)
        got = resolve(backend.name)(splats, view, RenderSettings(depth=True))  # pyright: ignore[reportArgumentType]
        adam.zero_grad()
        loss = got.rgb.sub(0.3).square().sum() + got.alpha.sum()
        loss.backward()
        assert loss.isfinite()
        assert all(p.grad is not None and p.grad.isfinite().all() for p in raw.values())
        adam.step()
        assert all(p.isfinite().all() for p in raw.values())
        assert (got.radii[~is_finite(splats)] == 0).all()
