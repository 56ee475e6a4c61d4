"""What `desplat-tradeoff` said of four captures, side by side.

python -m lab.front.studies FOLDER=NAME ...    (an output of desplat-tradeoff, its capture)
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

from desplat_ns.studies.grid.records import Record, Records
from desplat_ns.studies.tradeoff.plan import BASE, TrainingPlan, compared, study_of
from desplat_ns.studies.tradeoff.subject import Subject
from desplat_ns.studies.tradeoff.summary import Measured, best_within, finals, measured
from lab.documents import DOCS
from lab.grid.tables import table

FOLDER = DOCS / "tradeoff"
"""results.json of each study, under the capture's name, and the plot of its trainings."""

SECONDS = (5, 15, 30, 60, 120)
"""Training times of the first table."""


def results() -> dict[str, dict[str, Any]]:
    """By the names of the captures."""
    found = sorted(FOLDER.glob("*.json"))
    return {path.stem: json.loads(path.read_text("utf8")) for path in found}


def keep(output: Path, name: str) -> Path:
    """Copy a study's figures and the plot of its trainings, without what is the machine's.

    Args:
        name: of the capture.
    """
    content = json.loads((output / "results.json").read_text("utf8"))
    content["subject"]["data"] = name
    content["failed"] = sorted(content["failed"])
    FOLDER.mkdir(exist_ok=True)
    target = FOLDER / f"{name}.json"
    target.write_text(json.dumps(content, indent=1) + "\n", "utf8")
    shutil.copyfile(output / "training.svg", FOLDER / f"{name}.svg")
    return target


def _measured(content: dict[str, Any]) -> list[Measured]:
    plan, subject = content["plan"], Subject.from_json(content["subject"])
    settled = TrainingPlan(plan["steps"], tuple(plan["settings"]), plan["most"])
    return measured(study_of(subject, settled).plan, records_of(content["training"]))


def records_of(rows: dict[str, dict[str, Any]]) -> Records:
    """The trainings' records, of `results.training_rows`."""
    return {
        name: Record(
            {k: v for k, v in row.items() if k not in ("curve", "commit")},
            row["commit"],
            None,
            curve=tuple(row["curve"]),
        )
        for name, row in rows.items()
    }


def time_table(studies: dict[str, dict[str, Any]]) -> str:
    """The most dB of the defaults within some training times, for each capture."""
    rows = []
    for name, content in studies.items():
        ours = [one for one in _measured(content) if one.setting == BASE]
        found = [best_within(seconds, ours) for seconds in SECONDS]
        cells = ["" if one is None else f"{one.psnr.median:.2f}" for one in found]
        rows.append([f"`{name}`", str(content["subject"]["photos"]), *cells])
    return table(["capture", "photos", *(f"{seconds} s" for seconds in SECONDS)], rows)


def settings_table(studies: dict[str, dict[str, Any]]) -> str:
    """For each setting and capture: dB against the defaults at as many steps, and times as long."""
    columns = {name: _against_base(content) for name, content in studies.items()}
    settings = dict.fromkeys(setting for column in columns.values() for setting in column)
    rows = [
        [setting, *(column.get(setting, "") for column in columns.values())] for setting in settings
    ]
    return table(["setting", *(f"`{name}`" for name in columns)], rows)


WERE = {"relocation": "relocation instead of cloning and splitting (3DGS as MCMC)"}
"""Variants of the kept studies that `desplat-tradeoff` has no more."""


def _against_base(content: dict[str, Any]) -> dict[str, str]:
    steps = content["plan"]["steps"]
    ends = {one.setting: one for one in finals(_measured(content)) if one.steps == steps}
    now = compared(Subject.from_json(content["subject"]).effects)
    what = WERE | {name: one.what for name, one in now.items()}
    if BASE not in ends:
        return {}
    base = ends.pop(BASE)
    return {what[setting]: _cell(one, base) for setting, one in ends.items() if setting in what}


def _cell(one: Measured, base: Measured) -> str:
    decibels = one.psnr.median - base.psnr.median
    longer = one.wall.median / base.wall.median
    seeds = f", {one.seeds} seeds" if one.seeds > 1 else ""
    return f"{decibels:+.2f} dB, {longer:.2f} x{seeds}"


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        folder, _, name = argument.partition("=")
        print(f"Wrote {keep(Path(folder), name)}.")
