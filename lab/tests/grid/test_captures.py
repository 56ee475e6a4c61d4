"""Captures are found, or made once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from desplat_ns.errors import DeSplatError
from lab.grid.captures import (
    DATA_VARIABLE,
    AlteredCapture,
    GeneratedCapture,
    RealCapture,
    made,
    place_of,
)
from lab.synthetic import SceneSpec


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
    assert capture.locate(tmp_path) == folder
    assert folder.parent == tmp_path and folder.name.startswith("tiny-")
    assert photo.stat().st_mtime_ns == written


def test_an_altered_capture_is_made_of_its_original(monkeypatch, tmp_path: Path):
    (tmp_path / "fox").mkdir()
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    originals = []

    def alter(original: Path, folder: Path) -> None:
        folder.mkdir()
        originals.append(original)

    capture = AlteredCapture("white", RealCapture("fox"), alter)
    folder = capture.locate(tmp_path)
    assert folder.name.startswith("white-") and capture.locate(tmp_path) == folder
    assert originals == [(tmp_path / "fox").resolve()]


def test_a_changed_spec_is_another_folder(tmp_path: Path):
    spec = SceneSpec.tiny()
    first, other = (
        GeneratedCapture("tiny", s) for s in (spec, replace(spec, num_points=spec.num_points - 1))
    )
    assert place_of(first, tmp_path) != place_of(other, tmp_path)


def test_an_altered_capture_of_another_original_is_another_folder():
    capture = AlteredCapture("white", RealCapture("fox"), lambda original, folder: None)
    other = AlteredCapture("white", RealCapture("badger"), capture.alter)
    assert place_of(capture, Path()) != place_of(other, Path())


def test_what_was_interrupted_is_made_again(tmp_path: Path):
    def fail(path: Path) -> None:
        path.mkdir()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "a", fail)
    assert not (tmp_path / "a").exists()
    assert made(tmp_path / "a", Path.mkdir).is_dir()
