"""nerfstudio's commands, run by a study: one thread each, what they say in a log."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks.machine import CHECKOUT
from desplat_ns.errors import DeSplatError

ENVIRONMENT = {
    "PYTHONPATH": str(CHECKOUT),
    "OMP_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OMP_WAIT_POLICY": "passive",
}
"""One thread, so that runs beside each other disturb each other little."""

QUIET = ("--experiment-name", "x", "--timestamp", "run", "--vis", "tensorboard")
QUIET += ("--steps-per-eval-image", "0", "--steps-per-eval-all-images", "0")
"""Options of ns-train: no viewer, no evaluation on the way, a folder of a known name."""


def run_command(line: list[object], log: Path, **environment: str) -> None:
    """Run one of the environment's commands.

    Raises:
        DeSplatError: it failed; the message names its log.
    """
    program, *arguments = map(str, line)
    command = [str(Path(sys.executable).with_name(program)), *arguments]
    with log.open("w") as file:
        done = subprocess.run(
            command,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=os.environ | ENVIRONMENT | environment,
        )
    if done.returncode != 0:
        raise DeSplatError(f"`{program}` failed. Its log: {log}")


def made(path: Path, make: Callable[[Path], object]) -> Path:
    """What `make` writes; beside its place first, so that a stopped study leaves nothing half."""
    if not path.exists():
        draft = path.with_name(f"{path.name}.draft")
        shutil.rmtree(draft, ignore_errors=True)
        make(draft)
        draft.rename(path)
    return path
