"""Processes that a study starts: one thread each, what they say in a log."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from desplat_ns.errors import DeSplatError

ONE_THREAD = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}
"""So that runs beside each other disturb each other little: waiting threads sleep."""

EXPERIMENT, TIMESTAMP = "x", "run"
"""Folders in which nerfstudio puts a run, so that it is found again."""

QUIET = ("--experiment-name", EXPERIMENT, "--timestamp", TIMESTAMP, "--vis", "tensorboard")
QUIET += ("--steps-per-eval-image", "0", "--steps-per-eval-all-images", "0")
"""Options of ns-train: no viewer, no evaluation on the way."""


def surroundings(**variables: str) -> dict[str, str]:
    """The environment of a process that a study starts.

    It imports what this process would, from a checkout as from an installed package.
    """
    found = os.pathsep.join(dict.fromkeys(os.path.abspath(place) for place in sys.path))
    return os.environ | {"PYTHONPATH": found} | variables


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
            env=surroundings(**(ONE_THREAD | environment)),
        )
    if done.returncode != 0:
        raise DeSplatError(f"`{program}` failed. Its log: {log}")
