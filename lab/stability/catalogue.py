"""Errors of each hard case of `tests/stability` as shares of their bounds, as a table."""

import math
from collections.abc import Sequence

import torch

from lab import markdown_table
from tests.backend.scenes import Backend
from tests.stability.cases import CASES, Case
from tests.stability.measure import Outcome, run


def measured(cases: Sequence[Case] = CASES) -> tuple[str, bool]:
    """A row for each scene of the catalogue with the largest error as a share of its bound, 1 of
    which is the promise, and whether every error is within its bound."""
    rows, is_kept = [], True
    for case in cases:
        torch_dtype = torch.float32 if case.exact_in_float32 else torch.float64
        backends = Backend("torch", "cpu", torch_dtype), Backend("numba", "cpu", torch.float32)
        outcomes = [run(case, backend) for backend in backends]
        rounded = 1 if case.exact_in_float32 else 2  # float64 as the reference
        for outcome in outcomes:
            is_kept &= outcome.finite and outcome.culled and not outcome.share > rounded
        rows.append([case.name, "culled" if case.culled else "right", *map(share_of, outcomes)])
    return markdown_table(["case", "promise", "torch", "numba"], rows), is_kept


def share_of(outcome: Outcome) -> str:
    """In words where the dtype cannot hold the scene."""
    if math.isnan(outcome.share):
        return "finite" if outcome.finite else "NOT finite"
    return f"{outcome.share:.3f}"
