"""Lists of names stay short, missing files are counted."""

from __future__ import annotations

from pathlib import Path

import pytest

from desplat_ns.data.checks import announce, check_files, list_names
from desplat_ns.errors import CaptureError


def test_ten_names_are_listed_and_the_rest_is_counted():
    assert list_names(["a", "b"]) == "a, b"
    assert list_names(str(i) for i in range(13)) == "0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and 3 more"


def test_all_missing_files_are_counted_at_once(tmp_path: Path):
    (tmp_path / "0.png").touch()
    paths = [tmp_path / f"{i}.png" for i in range(13)]
    with pytest.raises(CaptureError) as caught:
        check_files(paths, tmp_path, "photos", "--images-path")
    assert str(caught.value).startswith("12 of 13 photos that the capture names are not in ")
    assert "1.png, 2.png" in str(caught.value)
    assert "10.png and 2 more. Put them there" in str(caught.value)
    assert "--images-path" in str(caught.value)


def test_a_missing_folder_is_named_instead_of_all_its_files(tmp_path: Path):
    with pytest.raises(CaptureError, match=r"The masks folder .*nowhere does not exist"):
        check_files([tmp_path / "nowhere" / "0.png"], tmp_path / "nowhere", "masks", "--masks-path")


def test_brackets_in_paths_survive_the_console(capsys: pytest.CaptureFixture[str]):
    announce("/a/[bold]/" + "x" * 200)
    assert capsys.readouterr().out == "/a/[bold]/" + "x" * 200 + "\n"
