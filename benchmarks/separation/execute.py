"""Train and evaluate one run in a process of its own, one thread each."""

from __future__ import annotations

import json
import os
from pathlib import Path
from threading import Lock
from typing import Any

from benchmarks.separation.hard_cases import make_case
from benchmarks.separation.runs import CLEAN, SCENES, SETTINGS, Run
from desplat_ns.errors import DeSplatError
from desplat_ns.studies.grid.commands import QUIET, made, run_command
from desplat_ns.studies.reproduce.baselines import METHODS
from desplat_ns.synthetic import write_scene

_writing = Lock()


def data_of(run: Run, folder: Path) -> Path:
    """The scene's folder; what is generated is made under `folder` at its first use.

    Raises:
        DeSplatError: the real scenes are not there.
    """
    scene = SCENES[run.scene]
    with _writing:
        if scene.spec is not None:
            spec, name = scene.spec, run.scene.removesuffix(CLEAN)
            return made(folder / name, lambda path: write_scene(spec, path))
        data = Path(os.environ.get("DESPLAT_NS_DATA", "")) / scene.folder
        if not data.is_dir():
            raise DeSplatError(
                f"The scene '{scene.folder}' is not at '{data}'. Set DESPLAT_NS_DATA to the folder "
                "that holds it, or choose runs on the generated scene: --only '*-yard*'."
            )
        case = scene.case
        if case is None:
            return data
        return made(folder / case, lambda path: make_case(case, data.resolve(), path))


def execute(run: Run, folder: Path) -> dict[str, Any]:
    """What `train_and_score` gives.

    Raises:
        DeSplatError: it failed; the message names its log.
    """
    setting, scene = SETTINGS[run.setting], SCENES[run.scene]
    output, results = folder / run.name, folder / run.name / "results.json"
    output.mkdir(parents=True, exist_ok=True)
    train: list[object] = [setting.method, "--data", data_of(run, folder)]
    train += ["--max-num-iterations", run.steps, "--machine.seed", run.seed]
    train += ["--output-dir", output, *QUIET, *setting.options, *scene.parser]
    train += ["--downscale-factor", run.downscale] if run.downscale > 1 else []
    command = ["python", "-m", "desplat_ns.studies.grid.train_and_score", results, *train]
    run_command(command, output / "run.log", NERFSTUDIO_METHOD_CONFIGS=METHODS)
    return json.loads(results.read_text())
