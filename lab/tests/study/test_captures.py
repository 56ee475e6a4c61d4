"""Captures that are made are made once, and whole."""

from pathlib import Path

import pytest

from desplat_ns.core.errors import DeSplatError
from lab.study.captures import CAPTURES, made


def test_what_is_made_is_whole(tmp_path: Path):
    def fails(path: Path) -> None:
        path.mkdir()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "scene", fails)
    assert not (tmp_path / "scene").exists()
    assert made(tmp_path / "scene", Path.mkdir).is_dir()
    assert made(tmp_path / "scene", fails).is_dir(), "it is there"


def test_a_capture_that_is_not_there_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("DESPLAT_NS_DATA", str(tmp_path))
    with pytest.raises(DeSplatError, match="DESPLAT_NS_DATA"):
        CAPTURES["fox"].locate(tmp_path)
