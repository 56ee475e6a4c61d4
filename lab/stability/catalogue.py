"""Errors of each hard case of `tests/stability` beside their bounds, as tables."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from desplat_ns.studies.records import markdown_table
from lab.stability import precise
from tests.backend.scenes import Backend
from tests.stability.cases import CASES, CULLED, RIGHT, Case
from tests.stability.formula_cases import FORMULA_CASES, FormulaCase
from tests.stability.measure import Outcome, run

BACKENDS = {
    "torch, float32": Backend("torch", "cpu", torch.float32),
    "torch, float64": Backend("torch", "cpu", torch.float64),
    "numba": Backend("numba", "cpu", torch.float32),
}
PROMISES = {CULLED: "culled", RIGHT: "right"}

NOTE = """\
Errors are value / gradient: of values relative to the largest value of their channel, of gradients
to the largest gradient by the same parameter, each the worst over pixels, Gaussians and parameters.
rho is the bound on the relative error of an alpha in float32. A share is the largest error over its
own bound, over all backends; 1 is the promise. The truth has 60 digits; of cases marked * it is the
float64 reference of the tests."""


def measured(
    cases: Sequence[Case] = CASES, formulas: Sequence[FormulaCase] = FORMULA_CASES
) -> tuple[str, bool]:
    """Both tables, and whether every error is within its bound."""
    scenes, scenes_kept = scene_table(cases)
    inputs, inputs_kept = formula_table(formulas)
    return f"{NOTE}\n\n{scenes}\n\n{inputs}", scenes_kept and inputs_kept


def scene_table(cases: Sequence[Case]) -> tuple[str, bool]:
    """One row for each scene of the catalogue."""
    rows, is_kept = [], True
    for case in cases:
        truth = precise.truth(case)
        outcomes = {name: run(case, backend, truth) for name, backend in BACKENDS.items()}
        compared = [o for o in outcomes.values() if not math.isnan(o.value_share)]
        shares = [
            max((getattr(o, kind) for o in compared), default=0.0)
            for kind in ("value_share", "gradient_share")
        ]
        is_kept &= max(shares) <= 1 and all(o.finite and o.culled for o in outcomes.values())
        bound = outcomes["numba"].bound
        rows.append(
            [
                case.name + ("" if case.by_mpmath else " *"),
                PROMISES.get(case.promise, case.promise),
                f"{bound:.0e}" if bound < 1 else "> 1",
                *map(errors, outcomes.values()),
                " / ".join(f"{share:.3f}" for share in shares),
            ]
        )
    return markdown_table(["case", "promise", "rho", *BACKENDS, "share"], rows), is_kept


def errors(outcome: Outcome) -> str:
    """Value and gradient error."""
    if math.isnan(outcome.value_error):
        return "finite" if outcome.finite else "NOT finite"
    return f"{outcome.value_error:.0e} / {outcome.gradient_error:.0e}"


def formula_table(formulas: Sequence[FormulaCase]) -> tuple[str, bool]:
    """One row for each hard input of a formula; errors are absolute."""
    rows, is_kept = [], True
    for case in formulas:
        row = [case.name, case.promise]
        for dtype in (torch.float32, torch.float64):
            pairs = case.run(dtype)
            is_kept &= all(pair.within for pair in pairs)
            row.append(" / ".join(f"{pair.error:.0e}" for pair in pairs))
            row.append(" / ".join(f"{pair.share:.2f}" for pair in pairs))
        rows.append(row)
    return markdown_table(
        ["input", "promise", "float32", "share", "float64", "share"], rows
    ), is_kept
