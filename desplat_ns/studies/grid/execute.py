"""Train and evaluate one run in a process of its own, one thread each."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from desplat_ns.studies.grid.commands import EXPERIMENT, TIMESTAMP, run_command
from desplat_ns.studies.grid.records import Record
from desplat_ns.studies.grid.runs import Run, Study
from desplat_ns.studies.grid.settings import method_config

PROGRAM = "desplat_ns.studies.grid.train_and_score"


def execute(study: Study, run: Run, folder: Path) -> Record:
    """The record of a run; what it trains stays in a folder of its name.

    Raises:
        DeSplatError: it failed; the message names its log.
    """
    output = folder / run.name
    shutil.rmtree(output, ignore_errors=True)  # of older code, if it is there
    output.mkdir(parents=True)
    results = output / "results.json"
    places = ["--data", study.scenes[run.scene].capture.locate(folder), "--output-dir", output]
    line = ["python", "-m", PROGRAM, results, study.settings[run.setting].method, *places]
    run_command([*line, "--machine.seed", run.seed, *study.options_of(run)], output / "run.log")
    return read_results(study, results)


def read_results(study: Study, path: Path) -> Record:
    """The figures that a study keeps, of a file that `train_and_score` wrote."""
    results = json.loads(path.read_text())
    figures = dict(results["figures"])
    if study.from_pictures is not None:
        figures |= study.from_pictures(path.with_name("pictures"))
    kept = {name: figures[name] for name in study.figures if name in figures}
    return Record(kept, results["commit"], results["settings"])


def config_of(study: Study, run: Run, folder: Path) -> Path:
    """Where nerfstudio's config.yml of an executed run is."""
    method = method_config(study.settings[run.setting].method).method_name
    return folder / run.name / EXPERIMENT / method / TIMESTAMP / "config.yml"
