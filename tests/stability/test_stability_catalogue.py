"""Every case of the catalogue on every backend; docs/dev/stability.md derives the bounds."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from tests.backend.scenes import BACKENDS, make_backend
from tests.stability.cases import CASES, Case
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
