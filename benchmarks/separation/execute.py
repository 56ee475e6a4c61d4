"""Train and evaluate one run through nerfstudio's commands, one thread each."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Any

from benchmarks.machine import CHECKOUT
from benchmarks.separation.baselines import METHODS
from benchmarks.separation.hard_cases import make_case
from benchmarks.separation.runs import SCENES, SETTINGS, Run
from desplat_ns.errors import DeSplatError
from desplat_ns.synthetic import SceneSpec, write_scene

ENVIRONMENT = {
    "NERFSTUDIO_METHOD_CONFIGS": METHODS,
    "PYTHONPATH": str(CHECKOUT),
    "OMP_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OMP_WAIT_POLICY": "passive",
}
"""One thread, so that runs beside each other disturb each other little."""


_writing = Lock()


def data_of(run: Run, folder: Path) -> Path:
    """The scene's folder; what is generated is made under `folder` at its first use.

    Raises:
        DeSplatError: the real scenes are not there.
    """
    scene = SCENES[run.scene]
    with _writing:
        if scene.folder is None:
            return _made(folder / "yard", lambda path: write_scene(SceneSpec(), path))
        data = Path(os.environ.get("DESPLAT_NS_DATA", "")) / scene.folder
        if not data.is_dir():
            raise DeSplatError(
                f"The scene '{scene.folder}' is not at '{data}'. Set DESPLAT_NS_DATA to the folder "
                "that holds it, or choose runs on the generated scene: --only '*-yard*'."
            )
        case = scene.case
        if case is None:
            return data
        return _made(folder / case, lambda path: make_case(case, data.resolve(), path))


def _made(path: Path, make: Callable[[Path], object]) -> Path:
    """What `make` writes; beside its place first, so that a stopped study leaves nothing half."""
    if not path.exists():
        draft = path.with_name(f"{path.name}.draft")
        shutil.rmtree(draft, ignore_errors=True)
        make(draft)
        draft.rename(path)
    return path


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
    train += ["--output-dir", output, "--experiment-name", "x", "--timestamp", "run"]
    train += ["--vis", "tensorboard", "--steps-per-eval-image", 0]
    train += ["--steps-per-eval-all-images", 0, *setting.options, *scene.parser]
    train += ["--downscale-factor", run.downscale] if run.downscale > 1 else []
    started = time.perf_counter()
    _call(train, output / "train.log")
    seconds = time.perf_counter() - started
    config = output / "x" / setting.method / "run" / "config.yml"
    _call(["ns-eval", "--load-config", config, "--output-path", metrics], output / "eval.log")
    return json.loads(metrics.read_text())["results"], seconds


def _call(line: list[object], log: Path) -> None:
    program, *arguments = map(str, line)
    command = [str(Path(sys.executable).with_name(program)), *arguments]
    with log.open("w") as file:
        done = subprocess.run(
            command, stdout=file, stderr=subprocess.STDOUT, env=os.environ | ENVIRONMENT
        )
    if done.returncode != 0:
        raise DeSplatError(f"`{program}` failed. Its log: {log}")
