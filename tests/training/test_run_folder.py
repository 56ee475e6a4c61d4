"""A run's folder: made with those around it, and taken away again if nothing came into it."""

from __future__ import annotations

from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.training.run_folder import run_folder


def test_what_goes_well_keeps_its_folder(tmp_path: Path):
    folder = tmp_path / "outputs" / "scene" / "run"
    with run_folder(folder):
        assert folder.is_dir()
    assert folder.is_dir()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_what_fails_leaves_nothing(tmp_path: Path, error: type[BaseException]):
    (tmp_path / "before").mkdir()
    with pytest.raises(error), run_folder(tmp_path / "outputs" / "scene" / "run"):
        raise error
    assert [path.name for path in tmp_path.iterdir()] == ["before"]


def test_what_was_there_before_stays_even_if_it_is_empty(tmp_path: Path):
    scene = tmp_path / "outputs" / "scene"
    scene.mkdir(parents=True)
    with pytest.raises(ValueError), run_folder(scene / "run"):
        raise ValueError
    assert scene.is_dir() and list(scene.iterdir()) == []


def test_a_folder_with_something_in_it_stays(tmp_path: Path):
    folder = tmp_path / "outputs" / "run"
    with pytest.raises(ValueError), run_folder(folder):
        (folder / "log.txt").write_text("kept")
        (folder.parent / "other").mkdir()
        raise ValueError
    assert (folder / "log.txt").read_text() == "kept"


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path):
    (tmp_path / "outputs").write_text("a file")
    expected = pytest.raises(ConfigError, match=r"outputs.run cannot be made .*--output-dir")
    with expected, run_folder(tmp_path / "outputs" / "run"):
        pytest.fail("went on")
    assert (tmp_path / "outputs").read_text() == "a file"
