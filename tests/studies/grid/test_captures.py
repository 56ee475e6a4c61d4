"""Captures are found, or made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from desplat_ns.errors import DeSplatError
from desplat_ns.studies.grid.captures import (
    DATA_VARIABLE,
    AlteredCapture,
    GeneratedCapture,
    RealCapture,
    made,
)
from desplat_ns.synthetic import SceneSpec


def test_a_real_capture_is_found_where_the_variable_says(monkeypatch, tmp_path: Path):
    (tmp_path / "fox").mkdir()
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    assert RealCapture("fox").locate(tmp_path / "out") == tmp_path / "fox"
    with pytest.raises(DeSplatError, match=f"'badger' is not at .*Set {DATA_VARIABLE}"):
        RealCapture("badger").locate(tmp_path)


def test_a_generated_capture_is_written_once(tmp_path: Path):
    capture = GeneratedCapture("tiny", SceneSpec.tiny())
    folder = capture.locate(tmp_path)
    photo = next((folder / "images").iterdir())
    written = photo.stat().st_mtime_ns
    assert capture.locate(tmp_path) == folder == tmp_path / "tiny"
    assert photo.stat().st_mtime_ns == written


def test_an_altered_capture_is_made_of_its_original(monkeypatch, tmp_path: Path):
    (tmp_path / "fox").mkdir()
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    seen = []

    def alter(original: Path, folder: Path) -> None:
        folder.mkdir()
        seen.append(original)

    capture = AlteredCapture("white", RealCapture("fox"), alter)
    assert capture.locate(tmp_path) == capture.locate(tmp_path) == tmp_path / "white"
    assert seen == [(tmp_path / "fox").resolve()]


def test_what_was_interrupted_is_made_again(tmp_path: Path):
    def fail(path: Path) -> None:
        path.mkdir()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "a", fail)
    assert not (tmp_path / "a").exists()
    assert made(tmp_path / "a", Path.mkdir).is_dir()
