"""One process at a time; a lock is gone with its process, however that ends."""

from __future__ import annotations

import errno
import os
import subprocess
import time
from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.files.lock import IN_USE, only_process_in
from tests.helpers.other_process import running

HOLDING = "from pathlib import Path; from desplat_ns.files.lock import *\nwith {}:\n    wait()"


def test_a_second_process_is_refused_at_once_with_the_folder_and_the_first(
    tmp_path: Path, checkout: Path
):
    folder = tmp_path / "out"
    with running(HOLDING.format(f"only_process_in(Path({str(folder)!r}))"), checkout) as other:
        begin = time.monotonic()
        said = rf"Process {other.pid} is at work in '{folder}'.*another folder"
        for _ in range(2):  # a refusal takes nothing away from the first
            with pytest.raises(ConfigError, match=said), only_process_in(folder):
                pass
        assert time.monotonic() - begin < 5
        with only_process_in(tmp_path / "another"):
            pass


@pytest.mark.parametrize("end", ["kill", "terminate"])
def test_the_lock_is_gone_with_a_process_that_was_ended(tmp_path: Path, checkout: Path, end: str):
    folder = tmp_path / "out"
    with running(HOLDING.format(f"only_process_in(Path({str(folder)!r}))"), checkout) as other:
        getattr(other, end)()
        other.wait()
        with only_process_in(folder):
            assert (folder / IN_USE).read_text() == str(os.getpid())
    assert not (folder / IN_USE).exists()


def test_where_the_file_system_has_no_locks_the_mark_that_stands_for_one_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """It says whose it is, so that the mark of a process that was killed is known as such."""
    monkeypatch.setattr("filelock._unix.fcntl.flock", no_locks)
    with only_process_in(tmp_path):
        assert (tmp_path / IN_USE).read_text() != str(os.getpid())
        assert str(os.getpid()) in (tmp_path / IN_USE).read_text()
    assert not (tmp_path / IN_USE).exists()


def no_locks(*_: object) -> None:
    raise OSError(errno.ENOSYS, "Function not implemented")


def test_a_process_that_this_one_started_does_not_keep_the_lock(tmp_path: Path):
    """A worker that outlives a killed process must not keep others out."""
    with only_process_in(tmp_path):
        sleeper = subprocess.Popen(["sleep", "60"], close_fds=False)
    with only_process_in(tmp_path):  # raises where it is kept
        assert sleeper.poll() is None
        sleeper.kill()
        sleeper.wait()


def test_a_folder_that_was_made_and_stayed_empty_is_gone_and_others_stay(tmp_path: Path):
    with only_process_in(tmp_path / "new"):
        assert (tmp_path / "new").is_dir()
    (tmp_path / "old").mkdir()
    with only_process_in(tmp_path / "old"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["old"]


def test_a_place_that_cannot_be_is_named(tmp_path: Path):
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match=r"file' is a file"), only_process_in(tmp_path / "file"):
        pass
    nowhere = Path("/proc/nothing")
    with (
        pytest.raises(ConfigError, match=r"written to .*nothing.*another folder"),
        only_process_in(nowhere),
    ):
        pass
