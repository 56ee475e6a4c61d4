"""Another Python beside this one, for what two processes must not do at once."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

WAIT = """
import sys

def wait():
    print("waiting", flush=True)
    sys.stdin.read()
"""


@contextmanager
def running(code: str, checkout: Path) -> Iterator[subprocess.Popen[str]]:
    """Within, a process has come to where its code calls `wait()`."""
    line = [sys.executable, "-c", WAIT + code]
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(line, cwd=checkout, text=True, **pipes) as process:
        assert process.stdout is not None
        try:
            lines = iter(process.stdout.readline, "")
            assert any(line == "waiting\n" for line in lines), "it ended before"
            yield process
        finally:
            process.kill()
