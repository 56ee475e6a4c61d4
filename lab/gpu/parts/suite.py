"""The tests that skip without a GPU, run."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from lab.documents import CHECKOUT
from lab.gpu.plan import Job
from lab.gpu.records import Figures
from lab.junit import read_results

MARK = "mark" + ".gpu"
"""In a file that marks tests, or what several test files take from it."""

QUICK = "tests/backend/test_gsplat_cuda.py"
"""What a rehearsal looks into."""


def measure(job: Job) -> Iterator[Figures]:
    """Numbers of tests by how they ended, and what was said of those that did not pass.

    Raises:
        RuntimeError: pytest ran none at all.
    """
    target = job.folder / "suite" / "results.xml"
    command = [sys.executable, "-m", "pytest", "-m", "gpu", "-p", "no:cacheprovider"]
    # A file that cannot be imported here is one error, not the end.
    command += ["--continue-on-collection-errors", f"--junitxml={target}"]
    command += [QUICK] if job.quick else places(CHECKOUT / "tests")
    done = subprocess.run(command, cwd=CHECKOUT)
    if not target.exists():
        raise RuntimeError(f"pytest ended with status {done.returncode} before any test ran.")
    yield read_results(target)


def places(tests: Path) -> list[str]:
    """Where tests are marked: collecting all others as well would take a minute. Files of tests;
    of others that mark, as the lists of backends do, the folder."""
    marking = [path for path in sorted(tests.rglob("*.py")) if MARK in path.read_text("utf8")]
    marked = [path if path.name.startswith("test_") else path.parent for path in marking]
    return [str(path) for path in dict.fromkeys(marked) if path.parent not in marked]
