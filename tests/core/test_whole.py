"""Files appear whole or not at all, and what is there is not lost."""

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.core.errors import ConfigError
from desplat_ns.core.whole import (
    IN_USE,
    check_new_file,
    check_new_folder,
    check_room,
    draft_of,
    only_process_in,
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
    path, folder = tmp_path / "a.ply", tmp_path / "masks"
    path.write_bytes(b"before")
    folder.mkdir()
    check_new_folder(folder, overwrite=False)
    (folder / "x").touch()
    for check, place in ((check_new_file, path), (check_new_folder, folder)):
        with pytest.raises(ConfigError, match="--overwrite"):
            check(place, overwrite=False)
        check(place, overwrite=True)
    write_whole(path, b"after")
    assert path.read_bytes() == b"after"


def test_what_cannot_be_written_is_named_with_its_option(tmp_path: Path):
    (tmp_path / "file").touch()
    for check, place in (
        (check_new_file, tmp_path),
        (check_new_folder, tmp_path / "file"),
        (check_new_file, tmp_path / "file" / "a.ply"),
        (check_new_file, Path("/proc/a.ply")),
    ):
        with pytest.raises(ConfigError, match="--here"):
            check(place, True, "--here")
    path = Path("/proc/nothing/a.ply")
    with pytest.raises(ConfigError, match="--strip"), plain_errors(path, "--strip"):
        write_whole(path, b"")


def test_a_folder_is_put_in_place_with_what_is_inside_and_one_that_fails_is_not(tmp_path: Path):
    with pytest.raises(RuntimeError), whole_folder(tmp_path / "masks") as folder:
        (folder / "a.png").touch()
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks" / "old.png").touch()
    with whole_folder(tmp_path / "masks") as folder:
        (folder / "left").mkdir()
        (folder / "left" / "a.png").write_bytes(b"1")
    paths = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert paths == {"masks", "masks/old.png", "masks/left", "masks/left/a.png"}


def test_a_disk_that_will_not_hold_it_is_said_first(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 10**9}))
    check_room(tmp_path, 10**9, "the runs need")
    with pytest.raises(ConfigError, match=str(tmp_path)):
        check_room(tmp_path, 2 * 10**9, "the runs need")


def test_a_draft_that_fails_leaves_what_was_there(tmp_path: Path):
    path = tmp_path / "a.jpg"
    path.write_bytes(b"before")
    with pytest.raises(RuntimeError), draft_of(path) as draft:
        assert draft.suffix == ".jpg", "writers choose the format by it"
        draft.write_bytes(b"aft")
        raise RuntimeError
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


HOLDING = """
import sys
from pathlib import Path
from desplat_ns.core.whole import only_process_in
with only_process_in(Path(sys.argv[1])):
    print("waiting", flush=True)
    sys.stdin.read()
"""


def test_a_second_process_is_refused_at_once_with_the_folder_until_the_first_is_killed(
    tmp_path: Path, checkout: Path
):
    folder = tmp_path / "out"
    line = [sys.executable, "-c", HOLDING, str(folder)]
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(line, cwd=checkout, text=True, **pipes) as other:
        assert other.stdout is not None and "waiting\n" in other.stdout, "it ended before"
        begin = time.monotonic()
        for _ in range(2):  # a refusal takes nothing away from the first
            with pytest.raises(ConfigError, match=str(folder)), only_process_in(folder):
                pass
        assert time.monotonic() - begin < 5
        with only_process_in(tmp_path / "another"):
            pass
        other.kill()
        other.wait()
        with only_process_in(folder):
            pass
    assert not (folder / IN_USE).exists()


def test_folders_that_were_made_and_stayed_empty_are_gone_and_others_stay(tmp_path: Path):
    with only_process_in(tmp_path / "around" / "new"):
        assert (tmp_path / "around" / "new").is_dir()
    (tmp_path / "old").mkdir()
    with only_process_in(tmp_path / "old"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["old"]


def test_a_place_that_cannot_be_worked_in_is_named(tmp_path: Path):
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", Path("/proc/nothing")):
        with pytest.raises(ConfigError, match=folder.name), only_process_in(folder):
            pass
