"""The files with what was measured, and how to enter more."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from desplat_ns.studies.train_and_score import where_of
from lab.documents import RECORDS
from lab.grid import records
from lab.grid.records import Record
from lab.grid.runs import Run
from lab.grid.settings import Settings
from lab.separation.runs import FIGURES

FILE = RECORDS / "separation.json"


def enter(
    run: Run,
    results: Mapping[str, Any],
    commit: str,
    settings: Settings,
    path: Path = FILE,
) -> None:
    """Enter what was measured elsewhere.

    Args:
        results: as `ns-eval` gives them, device and backend among them, with `train_cpu_seconds`.
        commit: the full hash of the code that was run.
        settings: what that code resolved, its own `python -m lab.grid.settings`;
            `STUDY.settings_of(run)` only where that code resolves the same as today's.
    """
    figures = {name: results[name] for name in FIGURES if name in results}
    where = where_of(results)
    record = Record(figures, commit, settings, where["device"], where["backend"])
    records.enter(path, run, record)
