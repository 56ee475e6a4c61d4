"""Files appear whole or not at all, and what is there is not lost."""

from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.export.new_files import (
    check_new_file,
    check_new_folder,
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
    found = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert found == {"masks", "masks/old.png", "masks/left", "masks/left/a.png"}


def test_a_place_that_cannot_be_written_is_named():
    with pytest.raises(ConfigError, match=r"/proc/nothing.* cannot be written"):
        write_whole(Path("/proc/nothing/a.ply"), b"")
    with pytest.raises(ConfigError, match="cannot be written"):
        check_new_file(Path("/proc/a.ply"), overwrite=False)
