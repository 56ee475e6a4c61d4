"""What happens to the worker: crashes, errors, the end of whoever started it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from desplat_ns.errors import CaptureError, DeSplatError
from desplat_ns.process.worker import LOG, Progress, in_worker

pytestmark = pytest.mark.slow


def crash(progress: Progress) -> None:
    """A native crash, after some work."""
    progress("mapping", 1, 2)
    os.kill(os.getpid(), signal.SIGSEGV)


def fail(progress: Progress) -> None:
    """An error of pycolmap's, which prints to the descriptors themselves."""
    progress("mapping", 1, 2)
    os.write(1, b"E1 said by the library\n")
    raise RuntimeError("no\nmore")


def refuse(progress: Progress) -> None:
    """A user's mistake."""
    raise CaptureError("move the camera")


@pytest.mark.parametrize(
    ("do", "kind", "said", "logged"),
    [
        (crash, DeSplatError, "mapping.*-11", ""),
        (fail, DeSplatError, r"mapping.*RuntimeError: no\)", "said by the library"),
        (refuse, CaptureError, "move the camera", ""),
    ],
)
def test_what_goes_wrong_there_is_an_error_here(do, kind, said, logged, tmp_path):
    with pytest.raises(kind, match=said):
        in_worker(tmp_path / "work", do)
    assert logged in (tmp_path / "work" / LOG).read_text()


def slow(marks: Path, progress: Progress) -> None:
    """Work that tells its process and does not end."""
    (marks / "pid").write_text(str(os.getpid()))
    time.sleep(600)


BUSY = """
import signal, sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts with & ignores it
from desplat_ns.process.worker import in_worker
from tests.process.test_worker import slow
if __name__ == "__main__":
    in_worker(Path(sys.argv[1]) / "work", slow, Path(sys.argv[1]))
"""


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_the_worker_ends_with_whoever_started_it(tmp_path: Path, checkout: Path, sent):
    line = [sys.executable, "-c", BUSY, str(tmp_path)]
    with subprocess.Popen(line, cwd=checkout, stderr=subprocess.DEVNULL) as parent:
        wait_until(lambda: (tmp_path / "pid").is_file() and (tmp_path / "pid").read_text() != "")
        worker = int((tmp_path / "pid").read_text())
        assert is_running(worker)
        parent.send_signal(sent)
        parent.wait(timeout=60)
    wait_until(lambda: not is_running(worker))
    assert not is_running(worker)


def is_running(pid: int) -> bool:
    """Whether there is such a process that has not ended."""
    return psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE


def wait_until(done: Callable[[], bool]) -> None:
    """Look every 50 ms, for a minute."""
    end = time.monotonic() + 60
    while not done():
        assert time.monotonic() < end
        time.sleep(0.05)
