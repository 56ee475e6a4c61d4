"""60 digits against float64: the truth of docs/dev/stability.md and that of the tests."""

from __future__ import annotations

import pytest
import torch

from lab.stability import precise
from tests.stability.bounds import error_bounds
from tests.stability.cases import ANTIALIASED, CASES, Case, hard, joined, witness
from tests.stability.measure import ByFloat64, compare, weights

NEGLIGIBLE = 1e-3
"""Of the bound of float32, whose rounding is 5e8 times as coarse as that of float64."""

HARDEST = {case.name: case for case in CASES if case.by_mpmath and "needle" in case.name}
EASY = Case("ordinary", lambda: joined(hard(), witness()), settings=ANTIALIASED)


@pytest.mark.parametrize("case", [EASY, *HARDEST.values()], ids=lambda case: case.name)
def test_what_the_reference_rounds_is_nothing_beside_what_float32_may(case: Case):
    factor = weights(case)
    bounds = error_bounds(case.drawn, case.settings, torch.float32, factor)
    factor = factor * bounds.safe[:, None]
    by_float64, exact = ByFloat64(case), precise.truth(case)
    reference = {n: torch.from_numpy(g) for n, g in by_float64.gradients(factor.numpy()).items()}
    _, values, _, gradients = compare(exact, bounds, by_float64.image, reference, factor)
    assert values <= NEGLIGIBLE
    assert gradients <= NEGLIGIBLE
