"""What `desplat-tradeoff` said of four captures, side by side.

python -m lab.front.studies FOLDER=NAME ...    (an output of desplat-tradeoff, its capture)
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

from desplat_ns.studies.capture_info import CaptureInfo
from desplat_ns.studies.plan import BASE, compared
from desplat_ns.studies.results import Results
from desplat_ns.studies.runs import Run, Variant
from desplat_ns.studies.summary import Measured, best_within, finals, measured
from lab.documents import RECORDS
from lab.grid.tables import table

FOLDER = RECORDS / "tradeoff"
"""results.json of each study, under the capture's name, and the plot of its trainings."""

SECONDS = (5, 15, 30, 60, 120)
"""Training times of the first table."""


def results() -> dict[str, dict[str, Any]]:
    """By the names of the captures."""
    paths = sorted(FOLDER.glob("*.json"))
    return {path.stem: json.loads(path.read_text("utf8")) for path in paths}


def keep(output: Path, name: str) -> Path:
    """Copy a study's figures and the plot of its trainings, without what is the machine's.

    Args:
        name: of the capture.
    """
    content = json.loads((output / "results.json").read_text("utf8"))
    content["capture"]["data"] = name
    content["failed"] = sorted(content["failed"])
    FOLDER.mkdir(exist_ok=True)
    target = FOLDER / f"{name}.json"
    target.write_text(json.dumps(content, indent=1) + "\n", "utf8")
    shutil.copyfile(output / "training.svg", FOLDER / f"{name}.svg")
    return target


def _measured(content: dict[str, Any]) -> list[Measured]:
    """In the order of the plan, of which the variants may have been others than today's."""
    results = Results.from_json({k: v for k, v in content.items() if k != "format"})
    assert results.plan is not None
    places = {name: place for place, name in enumerate(results.plan.variants)}
    parts = sorted(
        (name.rsplit("-", 2) for name in results.training),
        key=lambda part: (places.get(part[0], len(places)), int(part[1])),
    )
    runs = [Run(Variant(name), int(steps), int(seed), Path()) for name, steps, seed in parts]
    return measured(runs, results.training)


def time_table(studies: dict[str, dict[str, Any]]) -> str:
    """The most dB of the defaults within some training times, for each capture."""
    rows = []
    for name, content in studies.items():
        ours = [measured for measured in _measured(content) if measured.variant == BASE]
        bests = [best_within(seconds, ours) for seconds in SECONDS]
        cells = ["" if best is None else f"{best.psnr.median:.2f}" for best in bests]
        rows.append([f"`{name}`", str(content["capture"]["photos"]), *cells])
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
    ends = {end.variant: end for end in finals(_measured(content)) if end.steps == steps}
    now = compared(CaptureInfo.from_json(content["capture"]).effects)
    what = WERE | {name: variant.what for name, variant in now.items()}
    if BASE not in ends:
        return {}
    base = ends.pop(BASE)
    return {what[setting]: _cell(end, base) for setting, end in ends.items() if setting in what}


def _cell(measured: Measured, base: Measured) -> str:
    decibels = measured.psnr.median - base.psnr.median
    longer = measured.wall.median / base.wall.median
    seeds = f", {len(measured.seeds)} seeds" if len(measured.seeds) > 1 else ""
    return f"{decibels:+.2f} dB, {longer:.2f} x{seeds}"


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        folder, _, name = argument.partition("=")
        print(f"Wrote {keep(Path(folder), name)}.")
