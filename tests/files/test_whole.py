"""Files appear whole or not at all, and what is there is not lost."""

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.files.whole import (
    check_new_file,
    check_new_folder,
    check_room,
    draft_of,
    plain_errors,
    whole_folder,
    write_whole,
)


def test_a_file_is_written_with_its_folders_and_nothing_beside_it(tmp_path: Path):
    path = tmp_path / "new" / "a.ply"
    check_new_file(path, overwrite=False)
    assert list(tmp_path.iterdir()) == []
    write_whole(path, b"content")
    assert path.read_bytes() == b"content"
    assert list(path.parent.iterdir()) == [path]


def test_what_is_there_is_kept_unless_it_may_be_overwritten(tmp_path: Path):
    path = tmp_path / "a.ply"
    path.write_bytes(b"before")
    with pytest.raises(ConfigError, match=r"already.*--overwrite"):
        check_new_file(path, overwrite=False)
    check_new_file(path, overwrite=True)
    write_whole(path, b"after")
    assert path.read_bytes() == b"after"
    folder = tmp_path / "masks"
    folder.mkdir()
    check_new_folder(folder, overwrite=False)
    (folder / "x").touch()
    with pytest.raises(ConfigError, match=r"not empty.*--overwrite"):
        check_new_folder(folder, overwrite=False)
    check_new_folder(folder, overwrite=True)


def test_a_file_and_a_folder_are_not_taken_for_each_other(tmp_path: Path):
    with pytest.raises(ConfigError, match="is a folder"):
        check_new_file(tmp_path, overwrite=True)
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="is a file"):
        check_new_folder(tmp_path / "file", overwrite=True)
    with pytest.raises(ConfigError, match=r"file' is a file; --output names something in it"):
        check_new_file(tmp_path / "file" / "a.ply", overwrite=False)


def test_a_folder_that_fails_half_way_leaves_nothing(tmp_path: Path):
    with pytest.raises(RuntimeError), whole_folder(tmp_path / "masks") as folder:
        (folder / "a.png").touch()
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_put_in_place_with_what_is_inside(tmp_path: Path):
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks" / "old.png").touch()
    with whole_folder(tmp_path / "masks") as folder:
        (folder / "left").mkdir()
        (folder / "left" / "a.png").write_bytes(b"1")
    paths = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert paths == {"masks", "masks/old.png", "masks/left", "masks/left/a.png"}


def test_a_place_that_cannot_be_written_is_named():
    path = Path("/proc/nothing/a.ply")
    with pytest.raises(OSError):
        write_whole(path, b"")
    with (
        pytest.raises(ConfigError, match=r"/proc/nothing.* cannot be written.*with --strip"),
        plain_errors(path, "--strip"),
    ):
        write_whole(path, b"")
    with pytest.raises(ConfigError, match="cannot be written"):
        check_new_file(Path("/proc/a.ply"), overwrite=False)


def test_a_disk_that_will_not_hold_it_is_said_first(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 10**9}))
    check_room(tmp_path / "absent", 10**9, "the runs need")
    with pytest.raises(ConfigError, match=r"room for 1\.0 GB, and the runs need 2\.0 GB.*--output"):
        check_room(tmp_path / "absent", 2 * 10**9, "the runs need")


def test_a_draft_that_fails_leaves_what_was_there(tmp_path: Path):
    path = tmp_path / "a.jpg"
    path.write_bytes(b"before")
    with pytest.raises(RuntimeError), draft_of(path) as draft:
        assert draft.suffix == ".jpg", "writers choose the format by it"
        draft.write_bytes(b"aft")
        raise RuntimeError
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


WRITING = """
import select, signal, sys
from pathlib import Path
from desplat_ns.files.whole import draft_of, whole_folder
ignored, place = sys.argv[1] == "ignored", Path(sys.argv[2])
if ignored:
    signal.signal(signal.SIGTERM, lambda *_: print("caught", flush=True))
with whole_folder(place / "masks") as folder:
    (folder / "a.png").touch()
    with draft_of(place / "a.ply") as draft:
        draft.write_bytes(b"half")
        print("writing", flush=True)
        while not select.select([sys.stdin], [], [], 0.05)[0]:
            pass  # a signal just before a call that waits would be answered after it only
    print("written", flush=True)
"""


@pytest.mark.parametrize("answered", [False, True])
def test_sigterm_leaves_no_draft_and_ends_the_process_unless_something_answers_it(
    tmp_path: Path, checkout: Path, answered: bool
):
    """In training something does: the step is finished and saved."""
    line = [sys.executable, "-c", WRITING, "ignored" if answered else "", str(tmp_path)]
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(line, cwd=checkout, text=True, **pipes) as process:
        assert process.stdin is not None and process.stdout is not None
        assert process.stdout.readline() == "writing\n"
        assert len(list(tmp_path.iterdir())) == 2, "both drafts are there"
        process.send_signal(signal.SIGTERM)
        if answered:
            assert process.stdout.readline() == "caught\n"
            process.stdin.write("\n")
            process.stdin.flush()
        status = process.wait(timeout=60)
    left = sorted(path.name for path in tmp_path.iterdir())
    if answered:
        assert (status, left) == (0, ["a.ply", "masks"])
    else:
        assert (status, left) == (-signal.SIGTERM, [])
