"""Run the tests on this machine in the guise of others, and write how they ended.

    python -m lab.guises                        the whole suite in every guise (hours)
    python -m lab.guises --part arithmetic --only avx2 gpu
    python -m lab.guises --only as-is           of this Python; `make test-pythons` does so

Prints a line for each run, and the failures; exits with 1 where there was one. With `--record` each
run is entered in docs/records/machines.json and the table of docs/dev/machines.md written again
from it.
"""

from __future__ import annotations

import argparse
import os
import platform
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from desplat_ns.studies.machine import describe_machine
from lab.arguments import parser_of
from lab.documents import CHECKOUT
from lab.guises.guises import GUISES, PRETEND, Guise
from lab.guises.report import enter
from lab.junit import read_results

ARITHMETIC = (
    *("backend", "calibration", "evaluation", "gaussians", "photo_tourism", "rendering"),
    *("separation", "survey", "training", "test_fake_cuda.py", "test_model.py"),
    *("test_model_gradients.py", "test_same_bits.py", "test_training_on_a_gpu.py"),
)
"""Of tests/: what computes, so that instructions, cores or a GPU can decide how a test ends."""

PARTS = {
    "all": ("tests", "lab/tests"),
    "arithmetic": (*(f"tests/{name}" for name in ARITHMETIC), "lab/tests/pixels"),
}


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_of("python -m lab.guises", __doc__)
    names = [guise.name for guise in GUISES]
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="GUISE")
    parser.add_argument("--part", choices=PARTS, default="all", help="of the suite (%(default)s)")
    parser.add_argument("--record", action="store_true", help="write docs/dev/machines.md")
    parser.add_argument("--pytest", default="", help="more for pytest: --pytest='-k name'")
    return parser.parse_args(arguments)


def environment(guise: Guise) -> dict[str, str]:
    """Variables of a process in that guise."""
    before = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([str(PRETEND), *filter(None, [before])])
    return {**os.environ, **guise.variables, "PYTHONPATH": path}


def run(guise: Guise, part: str, options: Sequence[str]) -> dict[str, Any]:
    """The tests in a guise: their numbers, and how long they took.

    Raises:
        RuntimeError: pytest ran none at all, or did not come to its end.
    """
    with tempfile.TemporaryDirectory(prefix="desplat-guise-") as folder:
        results = Path(folder, "results.xml")
        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider"]
        command += [f"--junitxml={results}", *options, *PARTS[part]]
        began = time.monotonic()
        done = subprocess.run(command, cwd=CHECKOUT, env=environment(guise))
        if done.returncode not in (0, 1) or not results.exists():
            raise RuntimeError(f"pytest ended with status {done.returncode} .")
        return {**read_results(results), "seconds": round(time.monotonic() - began)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 0 where everything passed."""
    chosen = parse_arguments(arguments)
    has_failed = False
    for guise in (guise for guise in GUISES if guise.name in chosen.only):
        print(f"==> {guise.title}, Python {platform.python_version()}", flush=True)
        results = run(guise, chosen.part, shlex.split(chosen.pytest))
        bad = results["failed"] + results["error"]
        has_failed |= bad > 0
        said = f"{results['passed']} passed, {bad} failed, {results['skipped']} skipped"
        print(f"==> {guise.title}: {said} in {results['seconds']} s", *results["bad"], sep="\n    ")
        if chosen.record:
            enter(guise, results | {"part": chosen.part}, describe_machine())
    return int(has_failed)


if __name__ == "__main__":
    sys.exit(main())
