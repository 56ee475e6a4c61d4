"""The whole way, on a few real photos; crashes; a second call."""

from __future__ import annotations

import json
import shutil
import sys

import numpy as np
import pytest

from desplat_ns.commands.process import run
from desplat_ns.errors import CaptureError, DeSplatError
from desplat_ns.layouts.recognition import recognise
from desplat_ns.process import jobs
from desplat_ns.process.folder import open_folder
from desplat_ns.process.request import Request


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
    told = compare(tmp_path / "out", known / "sparse" / "0")
    assert told.num_known - len(told.missing) == 12
    assert told.largest < 0.01
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


CRASH = "import os, signal; input(); os.kill(os.getpid(), signal.SIGSEGV)"
FAIL = "import json; input(); print(json.dumps({'error': 'RuntimeError: no'})); raise SystemExit(1)"


@pytest.mark.parametrize(
    ("program", "said"), [(CRASH, "ended by SIGSEGV during 'mapping'"), (FAIL, "RuntimeError: no")]
)
def test_a_crash_of_the_worker_is_an_error_that_says_where(program, said, tmp_path, monkeypatch):
    monkeypatch.setattr(jobs, "COMMAND", (sys.executable, "-c", program))
    folder = open_folder(tmp_path / "out", {}, {})
    with pytest.raises(DeSplatError, match=said):
        jobs.run_job(folder, "mapping", "mapping", {"threads": 1})
    assert json.loads((tmp_path / "out" / "process.json").read_text())["stages"] == {}


def test_alignment_finds_a_similarity():
    from lab.process import aligned

    rng = np.random.default_rng(0)
    known = rng.normal(size=(6, 3))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(aligned(0.3 * known @ turn + [1, 2, 3], known), known, atol=1e-12)
