"""Errors of each hard case of `tests/stability` beside their bounds, as a table."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from lab import markdown_table
from tests.backend.scenes import Backend
from tests.stability.cases import CASES, Case
from tests.stability.measure import Outcome, run

NOTE = """\
Errors are value / gradient: of values relative to the largest value of their channel, of gradients
to the largest gradient by the same parameter, each the worst over pixels, Gaussians and parameters.
rho is the bound on the relative error of an alpha in float32. A share is the largest error over its
own bound, over both backends; 1 is the promise. The truth is the float64 reference of the tests."""


def measured(cases: Sequence[Case] = CASES) -> tuple[str, bool]:
    """A row for each scene of the catalogue, and whether every error is within its bound."""
    rows, is_kept = [], True
    for case in cases:
        torch_dtype = torch.float32 if case.exact_in_float32 else torch.float64
        backends = Backend("torch", "cpu", torch_dtype), Backend("numba", "cpu", torch.float32)
        outcomes = [run(case, backend) for backend in backends]
        compared = [o for o in outcomes if not math.isnan(o.value_share)]
        shares = [max(o.value_share for o in compared), max(o.gradient_share for o in compared)]
        rounded = 1 if case.exact_in_float32 else 2  # float64 as the reference
        is_kept &= max(shares) <= rounded and all(o.finite and o.culled for o in outcomes)
        bound = outcomes[1].bound
        rows.append(
            [
                case.name,
                "culled" if case.culled else "right",
                f"{bound:.0e}" if bound < 1 else "> 1",
                *map(errors, outcomes),
                " / ".join(f"{share:.3f}" for share in shares),
            ]
        )
    head = ["case", "promise", "rho", "torch", "numba", "share"]
    return f"{NOTE}\n\n{markdown_table(head, rows)}", is_kept


def errors(outcome: Outcome) -> str:
    """Value and gradient error."""
    if math.isnan(outcome.value_error):
        return "finite" if outcome.finite else "NOT finite"
    return f"{outcome.value_error:.0e} / {outcome.gradient_error:.0e}"
