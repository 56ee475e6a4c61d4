"""Every case of the catalogue on every backend; docs/dev/stability.md derives the bounds."""

from typing import Any

import pytest
import torch

from tests.backend.scenes import EXACT_BACKENDS, make_backend
from tests.stability.cases import CASES, Case
from tests.stability.measure import run


def pairs(dtype: torch.dtype, exact_in_float32: bool) -> list[Any]:
    """Each case of a kind with each backend of a dtype."""
    return [
        pytest.param(case, backend.values[0], id=f"{backend.id}-{case.name}", marks=backend.marks)
        for case in CASES
        for backend in EXACT_BACKENDS
        if backend.values[0][2] == dtype and case.exact_in_float32 == exact_in_float32
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "backend"), [*pairs(torch.float32, True), *pairs(torch.float64, False)]
)
def test_a_hard_scene_is_as_promised(case: Case, backend: tuple[str, str, torch.dtype]):
    """In the dtype that holds it: the code is the same in both."""
    made = make_backend(*backend)
    outcome = run(case, made)
    assert outcome.finite
    assert outcome.culled
    assert outcome.drawn
    assert outcome.safe >= 0.9, "a case that leaves out more pixels tests nothing"
    rounded = 2 if made.dtype == torch.float64 else 1  # so is the reference
    assert outcome.share <= rounded


@pytest.mark.slow
@pytest.mark.parametrize(("case", "backend"), pairs(torch.float32, False))
def test_what_float32_cannot_hold_is_finite_in_it(
    case: Case, backend: tuple[str, str, torch.dtype]
):
    outcome = run(case, make_backend(*backend))
    assert outcome.finite
    assert outcome.culled
