"""Train and evaluate one run in a process of its own, one thread each."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from desplat_ns.studies.grid.commands import EXPERIMENT, TIMESTAMP, run_command
from desplat_ns.studies.grid.records import Record
from desplat_ns.studies.grid.runs import Run, Study
from desplat_ns.studies.grid.settings import method_config

PROGRAM = "desplat_ns.studies.grid.train_and_score"
RESULTS = "results.json"


def execute(study: Study, run: Run, folder: Path) -> Record:
    """The record of a run; what it trains stays in a folder of its name.

    An earlier one of that name is replaced once this one is whole.

    Raises:
        DeSplatError: the capture is not there; or training or evaluation failed, and the message
            names its log.
    """
    data = study.scenes[run.scene].capture.locate(folder)
    draft = log_of(run, folder).parent
    shutil.rmtree(draft, ignore_errors=True)  # of a run that failed, if it is there
    draft.mkdir(parents=True)
    results = draft / RESULTS
    places = ["--data", data, "--output-dir", draft]
    method = study.settings[run.setting].method
    line = ["python", "-m", PROGRAM, results, study.evaluations, method, *places]
    run_command([*line, "--machine.seed", run.seed, *study.options_of(run)], log_of(run, folder))
    found = read_results(study, run, results)
    _settle(draft, folder / run.name)
    return found


def log_of(run: Run, folder: Path) -> Path:
    """Where a run that is being done, or that failed, says what happens."""
    return folder / f"{run.name}.draft" / "run.log"


def _settle(draft: Path, output: Path) -> None:
    """Put a finished run where it is looked for; its config.yml says so, too."""
    for config in draft.glob(f"{EXPERIMENT}/*/{TIMESTAMP}/config.yml"):
        text = config.read_text()  # nerfstudio writes a path as a list of its parts
        config.write_text(text.replace(f"- {draft.name}\n", f"- {output.name}\n"))
    shutil.rmtree(output, ignore_errors=True)
    draft.rename(output)


def read_results(study: Study, run: Run, path: Path) -> Record:
    """The figures that a study keeps, of a file that `train_and_score` wrote."""
    results = json.loads(path.read_text())

    def kept(figures: Mapping[str, Any], *more: str) -> dict[str, Any]:
        return {name: figures[name] for name in (*more, *study.figures) if name in figures}

    settings = results["settings"] | study.scene_of(run)
    curve = tuple(kept(point, "step") for point in results["curve"])
    where = (results["device"], results["backend"])
    return Record(kept(results["figures"]), results["commit"], settings, *where, curve)


def config_of(study: Study, run: Run, folder: Path) -> Path:
    """Where nerfstudio's config.yml of an executed run is."""
    method = method_config(study.settings[run.setting].method).method_name
    return folder / run.name / EXPERIMENT / method / TIMESTAMP / "config.yml"
