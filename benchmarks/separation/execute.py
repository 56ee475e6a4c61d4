"""Train and evaluate one run through nerfstudio's commands, one thread each."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from threading import Lock
from typing import Any

from benchmarks.commands import QUIET, made, run_command
from benchmarks.separation.baselines import METHODS
from benchmarks.separation.hard_cases import make_case
from benchmarks.separation.runs import SCENES, SETTINGS, Run
from desplat_ns.errors import DeSplatError
from desplat_ns.synthetic import SceneSpec, write_scene

_writing = Lock()


def data_of(run: Run, folder: Path) -> Path:
    """The scene's folder; what is generated is made under `folder` at its first use.

    Raises:
        DeSplatError: the real scenes are not there.
    """
    scene = SCENES[run.scene]
    with _writing:
        if scene.folder is None:
            return made(folder / "yard", lambda path: write_scene(SceneSpec(), path))
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


def execute(run: Run, folder: Path) -> tuple[dict[str, Any], float]:
    """Results of `ns-eval` and the seconds that training took.

    Raises:
        DeSplatError: one of the commands failed; the message names its log.
    """
    setting, scene = SETTINGS[run.setting], SCENES[run.scene]
    output, metrics = folder / run.name, folder / run.name / "metrics.json"
    output.mkdir(parents=True, exist_ok=True)
    train: list[object] = ["ns-train", setting.method, "--data", data_of(run, folder)]
    train += ["--max-num-iterations", run.steps, "--machine.seed", run.seed]
    train += ["--output-dir", output, *QUIET, *setting.options, *scene.parser]
    train += ["--downscale-factor", run.downscale] if run.downscale > 1 else []
    started = time.perf_counter()
    run_command(train, output / "train.log", NERFSTUDIO_METHOD_CONFIGS=METHODS)
    seconds = time.perf_counter() - started
    config = output / "x" / setting.method / "run" / "config.yml"
    evaluate: list[object] = ["ns-eval", "--load-config", config, "--output-path", metrics]
    run_command(evaluate, output / "eval.log", NERFSTUDIO_METHOD_CONFIGS=METHODS)
    return json.loads(metrics.read_text())["results"], seconds
