"""The whole way, on a few real photos; crashes; a second call."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest

from desplat_ns.commands.process import run
from desplat_ns.errors import CaptureError, DeSplatError
from desplat_ns.layouts.recognition import recognise
from desplat_ns.process import jobs
from desplat_ns.process.request import Request
from desplat_ns.process.workspace import open_workspace


@pytest.mark.slow
@pytest.mark.real_data
def test_photos_become_a_capture_with_the_known_poses(data_folder, tmp_path, capsys):
    """Centres within 1% of the scene's extent; what cannot be read is named and left out."""
    from lab.process import compare

    known, photos = data_folder("monstree"), tmp_path / "fotos über"
    photos.mkdir()
    for path in sorted((known / "images").iterdir())[5:17]:
        shutil.copy(path, photos)
    (photos / "cut off.jpg").write_bytes(path.read_bytes()[:5000])
    request = Request(photos, tmp_path / "out", effort="plain", threads=2)
    run(request)
    result = compare(tmp_path / "out", known / "sparse" / "0")
    assert result.num_known - len(result.missing) == 12
    assert result.largest < 0.01
    assert recognise(tmp_path / "out").match.layout.name == "COLMAP"
    assert (tmp_path / "out" / "cameras.png").is_file()
    assert not (tmp_path / "out" / "work").exists()
    said = capsys.readouterr().out
    assert "cut off.jpg (cannot be read" in said and "12 of 12 photos have a pose" in said
    run(request)
    assert "is made already" in capsys.readouterr().out


def test_photos_that_are_all_the_same_are_told_and_nothing_is_left(photo_writer, tmp_path):
    for name in "abcd":
        photo_writer(tmp_path / "p" / f"{name}.png", 60, 40)
    with pytest.raises(CaptureError, match=r"1 of 4 photos.*the same picture as a\.png"):
        run(Request(tmp_path / "p", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def crash(threads: int, progress: Callable[[int, int], None]) -> None:
    """A native crash, after some work."""
    progress(threads, 2)
    os.kill(os.getpid(), signal.SIGSEGV)


def fail(threads: int, progress: Callable[[int, int], None]) -> None:
    """An error of pycolmap's, which prints to the descriptors themselves."""
    os.write(1, b"E1 said by the library\n")
    raise RuntimeError("no\nmore")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("job", "said", "logged"),
    [
        (crash, "ended by SIGSEGV during 'mapping'", ""),
        (fail, r"failed during 'mapping' \(RuntimeError: no\)", "said by the library"),
    ],
)
def test_a_crash_of_the_worker_is_an_error_that_says_where(job, said, logged, tmp_path):
    folder = open_workspace(tmp_path / "out", {}, {})
    folder.stage("features", lambda: {"a.jpg": 7})
    with pytest.raises(DeSplatError, match=said):
        jobs.run_job(folder, "mapping", f"{__name__}.{job.__name__}", {"threads": 1})
    assert logged in folder.log.read_text()
    stages = json.loads((tmp_path / "out" / "process.json").read_text())["stages"]
    assert stages["features"]["result"] == {"a.jpg": 7}


@pytest.mark.slow
def test_a_worker_that_ends_before_it_can_write_its_log_is_an_error_like_any_other(tmp_path):
    folder = open_workspace(tmp_path / "out", {}, {})
    folder.log.mkdir(parents=True)
    with pytest.raises(DeSplatError, match=r"failed during 'mapping'\. What is done is kept"):
        jobs.run_job(folder, "mapping", f"{__name__}.{fail.__name__}", {"threads": 1})


def slow(marks: Path, progress: Callable[[int, int], None]) -> None:
    """Work that tells its process and does not end."""
    (marks / "pid").write_text(str(os.getpid()))
    time.sleep(600)


BUSY = """
import signal, sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts with & ignores it
from desplat_ns.process import jobs
from desplat_ns.process.workspace import open_workspace
place = Path(sys.argv[1])
jobs.run_job(open_workspace(place / "out", {}, {}), "mapping", sys.argv[2], {"marks": place})
"""


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_the_worker_ends_with_whoever_started_it(tmp_path, checkout, sent):
    line = [sys.executable, "-c", BUSY, str(tmp_path), f"{__name__}.slow"]
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


def test_alignment_finds_a_similarity():
    from lab.process import distances

    rng = np.random.default_rng(0)
    known = rng.normal(size=(6, 3))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert distances(0.3 * known @ turn + [1, 2, 3], known).max() < 1e-12
