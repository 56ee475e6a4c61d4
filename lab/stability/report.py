"""Measure the catalogue of hard cases, poison every backend, and write docs/dev/stability.md.

    python -m lab.stability            (--quick --output somewhere: a check only)

What notices which wrong sign comes from docs/records/stability.json, which `mutations` writes;
kills, damaged files and the long run from docs/records/faults.json and docs/records/soak.json
(`faults`, `soak`).
"""

from __future__ import annotations

import math
import random
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from string import Template

import torch

from lab.arguments import parse_measurement, parser_of
from lab.documents import DEV, RECORDS
from lab.grid.tables import table
from lab.stability import precise
from lab.stability.fault_tables import fault_figures
from lab.stability.mutations import MUTATIONS, record
from tests.backend.scenes import Backend
from tests.stability.cases import CASES, CULLED, RIGHT, Case
from tests.stability.formula_cases import FORMULA_CASES, Pair
from tests.stability.measure import Outcome, run
from tests.stability.poison import CAMERA, PLACES, POISON, Dose, Fate, give

TEMPLATE = Path(__file__).with_name("stability.md.template")
REPORT = "stability.md"

BACKENDS = {
    "torch, float32": Backend("torch", "cpu", torch.float32),
    "torch, float64": Backend("torch", "cpu", torch.float64),
    "numba": Backend("numba", "cpu", torch.float32),
}

INPUTS = 2000
"""Poisoned scenes for each backend."""


def scene_table(cases: Sequence[Case]) -> str:
    """One row for each scene of the catalogue."""
    rows = []
    for case in cases:
        exact = precise.truth(case)
        outcomes = {name: run(case, backend, exact) for name, backend in BACKENDS.items()}
        assert all(o.finite and o.culled for o in outcomes.values()), case.name
        shares = [
            max(getattr(o, kind) for o in outcomes.values() if not math.isnan(o.value_share))
            for kind in ("value_share", "gradient_share")
        ]
        promise = {CULLED: "culled", RIGHT: "right"}.get(case.promise, case.promise)
        rows.append(
            [
                case.name + ("" if case.by_mpmath else " *"),
                promise.replace(RIGHT, "right"),
                f"{outcomes['numba'].bound:.0e}" if outcomes["numba"].bound < 1 else "> 1",
                *(errors(outcome) for outcome in outcomes.values()),
                " / ".join(f"{share:.3f}" for share in shares),
            ]
        )
    return table(["case", "promise", "rho", *BACKENDS, "share"], rows)


def errors(outcome: Outcome) -> str:
    """Value and gradient error."""
    if math.isnan(outcome.value_error):
        return "finite"
    return f"{outcome.value_error:.0e} / {outcome.gradient_error:.0e}"


def formula_table() -> str:
    """One row for each hard input of a formula."""

    def cells(pairs: tuple[Pair, Pair]) -> list[str]:
        assert all(pair.within for pair in pairs)
        errors = " / ".join(f"{pair.error:.0e}" for pair in pairs)
        return [errors, " / ".join(f"{pair.share:.2f}" for pair in pairs)]

    rows = [
        [case.name, case.promise, *cells(case.run(torch.float32)), *cells(case.run(torch.float64))]
        for case in FORMULA_CASES
    ]
    return table(["input", "promise", "float32", "share", "float64", "share"], rows)


def random_doses(rng: random.Random) -> list[Dose]:
    """One to six values; parameters three times as often as what there is once."""
    into = [*PLACES] * 3 + [*CAMERA]
    return [
        Dose(rng.choice(into), rng.randrange(3), rng.randrange(16), rng.choice(POISON))
        for _ in range(rng.randint(1, 6))
    ]


def poison_all(inputs: int) -> tuple[str, float]:
    """Table of what became of the poisoned scenes, and the longest time that one took, seconds."""
    rng, slowest = random.Random(0), 0.0
    fates = {name: Counter() for name in BACKENDS}
    for _ in range(inputs):
        doses, degree, antialiased = random_doses(rng), rng.choice([None, 1]), rng.random() < 0.5
        for name, backend in BACKENDS.items():
            started = time.perf_counter()
            fates[name][kind_of(give(backend, doses, degree, antialiased))] += 1
            slowest = max(slowest, time.perf_counter() - started)
    kinds = ("refused with a message", "drawn, something culled", "drawn, nothing culled", "faults")
    rows = [[name, f"{inputs:,}", *(f"{f[kind]:,}" for kind in kinds)] for name, f in fates.items()]
    return table(["", "inputs", *kinds], rows), slowest


def kind_of(fate: Fate) -> str:
    if fate.refused:
        return "refused with a message"
    if fate.faults:
        return "faults"
    return "drawn, something culled" if fate.culled else "drawn, nothing culled"


def code(text: str) -> str:
    """As code, inside a table."""
    return f"`{text}`".replace("|", "\\|") if text else "(nothing)"


def mutation_figures() -> dict[str, str]:
    """Who notices which change."""
    noticed = record()
    rows = [
        [m.name, code(m.old), code(m.new), code(noticed[m.name] or "nobody")] for m in MUTATIONS
    ]
    return {
        "table": table(["change", "line", "becomes", "noticed first by"], rows),
        "noticed": str(sum(test is not None for test in noticed.values())),
        "mutations": str(len(MUTATIONS)),
    }


def write_report(folder: Path, cases: Sequence[Case], inputs: int) -> Path:
    """Measure and fill in the template; returns where the page is."""
    fuzz, slowest = poison_all(inputs)
    text = Template(TEMPLATE.read_text()).substitute(
        scenes=scene_table(cases),
        formulas=formula_table(),
        poison=", ".join(f"{value:g}" for value in POISON),
        fuzz=fuzz,
        slowest=f"{slowest:.1f}",
        **mutation_figures(),
        **fault_figures(RECORDS),
    )
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / REPORT
    path.write_text(text)
    return path


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = parser_of("python -m lab.stability", __doc__)
    chosen = parse_measurement(parser, DEV, arguments)
    torch.set_num_threads(1)
    cases, inputs = (CASES[:3], 5) if chosen.quick else (CASES, INPUTS)
    print(write_report(chosen.output, cases, inputs))
