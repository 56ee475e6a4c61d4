"""A run is trained and scored in a process of its own, which says what its scores are of."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from desplat_ns.errors import DeSplatError
from desplat_ns.studies import runs as module
from desplat_ns.studies.machine import code_version
from desplat_ns.studies.runs import Run, execute
from lab.synthetic import Scene

REST = {"commit": "c", "device": "cpu", "device_name": "a CPU", "backend": "numba"}


def run_on(folder: Path | None) -> Run:
    options = ("--pipeline.model.num-downscales", "0")
    return Run("ours", "desplat", options, 3, 42, folder or Path("/absent"), ("robustnerf-data",))


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_a_run_gives_scores_and_says_of_which_code_and_on_what(tiny_scene: Scene, tmp_path: Path):
    run = run_on(tiny_scene.folder)
    record = execute(run, tmp_path)
    assert {"psnr", "mask_iou", "num_masks"} <= set(record.scores)
    assert 0 < record.scores["train_wall_seconds"] < record.seconds
    assert record.scores["backend"] in ("numba", "gsplat") and "torch" in record.scores["versions"]
    assert (record.commit, record.key) == (code_version(), run.key)
    assert len(list((tmp_path / "ours-3-42" / "pictures").glob("*.png"))) == 2
    assert not list(tmp_path.rglob("nerfstudio_models")), "nobody needs them"


@pytest.fixture
def program(tmp_path: Path, monkeypatch):
    """Put a line of Python in the place of the program that trains and scores."""

    def put(line: str) -> None:
        (tmp_path / "probe.py").write_text(f"import json, os, sys\n{line}\n")

    monkeypatch.syspath_prepend(tmp_path)  # what this process can import, the other can
    monkeypatch.setattr(module, "PROGRAM", "probe")
    return put


def writing(figures: str) -> str:
    return f"json.dump(dict({REST!r}, figures={figures}), open(sys.argv[1], 'w'))"


def test_the_process_has_one_thread_and_sleeps_while_it_waits(program, monkeypatch, tmp_path: Path):
    for name in (names := ("OMP_WAIT_POLICY", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")):
        monkeypatch.delenv(name, raising=False)
    program(writing("dict(os.environ)"))
    record = execute(run_on(tmp_path), tmp_path / "runs")
    assert [record.scores[name] for name in names] == ["passive", "1", "1"]


def test_numbers_and_texts_are_kept(program, tmp_path: Path):
    program(writing("{'psnr': 1.5, 'images': [1], 'protocol': 'half', 'versions': {'a': '1'}}"))
    record = execute(run_on(tmp_path), tmp_path / "runs")
    assert record.scores == {"psnr": 1.5, "protocol": "half", "versions": "a 1"}
    given = "--max-num-iterations 3 --pipeline.model.num-downscales 0 robustnerf-data"
    assert record.key == ("desplat", given, str(tmp_path), 42)


def test_an_earlier_run_stays_until_another_is_whole(program, tmp_path: Path):
    earlier = tmp_path / "runs" / "ours-3-42"
    earlier.mkdir(parents=True)
    (earlier / "mine").touch()
    with pytest.raises(DeSplatError, match="/absent"):
        execute(run_on(None), tmp_path / "runs")
    program("sys.exit('no')")
    with pytest.raises(DeSplatError, match=r"Its log: .*run\.log"):
        execute(run_on(tmp_path), tmp_path / "runs")
    assert (earlier / "mine").exists()
    program(writing("{}"))
    execute(run_on(tmp_path), tmp_path / "runs")
    assert sorted(path.name for path in earlier.iterdir()) == ["results.json", "run.log"]
    assert json.loads((earlier / "results.json").read_text())["commit"] == "c"
