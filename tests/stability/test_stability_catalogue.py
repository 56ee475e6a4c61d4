"""Every case of the catalogue on every backend; docs/dev/stability.md derives the bounds."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from desplat_ns.backend import RenderSettings, resolve
from desplat_ns.backend.inputs import is_finite
from desplat_ns.gaussians.activation import activate_static
from tests.backend.scenes import BACKENDS, make_backend
from tests.stability.cases import CASES, Case, hard
from tests.stability.formula_cases import FORMULA_CASES, FormulaCase
from tests.stability.measure import run

SAFE = 0.9
"""Least share of pixels that are compared; a case that leaves out more tests nothing."""

DTYPES = {"float32": torch.float32, "float64": torch.float64}

EXACT: list[Any] = [p for p in BACKENDS if p.id != "gsplat"]
"""gsplat cuts opaque Gaussians off at 3 sigma, by design."""


def pairs(cases: tuple[Case, ...], dtype: torch.dtype) -> list[Any]:
    """Each of some cases with each backend of a dtype."""
    return [
        pytest.param(case, backend.values[0], id=f"{backend.id}-{case.name}", marks=backend.marks)
        for case in cases
        for backend in EXACT
        if backend.values[0][2] == dtype
    ]


ORDINARY = tuple(case for case in CASES if case.exact_in_float32)
FINE = tuple(case for case in CASES if not case.exact_in_float32)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "backend"), [*pairs(ORDINARY, torch.float32), *pairs(FINE, torch.float64)]
)
def test_a_hard_scene_is_as_promised(case: Case, backend: tuple[str, str, torch.dtype]):
    """In the dtype that holds it: the code is the same in both."""
    made = make_backend(*backend)
    outcome = run(case, made)
    assert outcome.finite
    assert outcome.culled
    assert outcome.drawn
    assert outcome.safe >= SAFE
    rounded = 2 if made.dtype == torch.float64 else 1  # so is the reference
    assert outcome.value_share <= rounded
    assert outcome.gradient_share <= rounded


@pytest.mark.slow
@pytest.mark.parametrize(("case", "backend"), pairs(FINE, torch.float32))
def test_what_float32_cannot_hold_is_finite_in_it(
    case: Case, backend: tuple[str, str, torch.dtype]
):
    outcome = run(case, make_backend(*backend))
    assert outcome.finite
    assert outcome.culled


@pytest.mark.parametrize("dtype", DTYPES.values(), ids=list(DTYPES))
@pytest.mark.parametrize("case", FORMULA_CASES, ids=lambda case: case.name)
def test_a_hard_input_of_a_formula_is_finite_and_as_promised(case: FormulaCase, dtype):
    values, gradients = case.run(dtype)
    assert values.within, values
    assert gradients.within, gradients


@pytest.mark.slow
@pytest.mark.parametrize("made_of", EXACT)
def test_a_learning_rate_spike_leaves_everything_finite(made_of: tuple[str, str, torch.dtype]):
    """One step far out, then two ordinary ones: what is lost is culled and counted."""
    backend = make_backend(*made_of)
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
