"""A run is trained and scored; runs without a record are done and recorded."""

from pathlib import Path
from typing import Any

import pytest

from desplat_ns.core.errors import DeSplatError
from desplat_ns.tools.studies import runs as module
from desplat_ns.tools.studies.machine import code_version
from desplat_ns.tools.studies.records import FILE, Key, Record, load
from desplat_ns.tools.studies.runs import Run, execute, finish
from tests.helpers.made_up_runs import made_up


def run_on(folder: Path | None) -> Run:
    options = ("--pipeline.model.num-downscales", "0")
    return Run("ours", "desplat", options, 3, 42, folder or Path("/absent"), ("robustnerf-data",))


@pytest.fixture
def trained(monkeypatch):
    """Put figures in the place of training and scoring, or an error."""

    def put(result: dict[str, Any] | Exception) -> None:
        def stand_in(*_: Any) -> tuple[dict[str, Any], str]:
            print("a step")
            if isinstance(result, Exception):
                raise result
            return result, "a CPU"

        monkeypatch.setattr(module, "train_and_score", stand_in)

    return put


def test_numbers_and_texts_of_the_evaluation_are_kept(trained, tmp_path: Path):
    trained({"psnr": 1.5, "images": [1], "versions": {"a": "1"}})
    record = execute(run_on(tmp_path), tmp_path / "runs")
    assert record.scores == {"psnr": 1.5, "versions": "a 1"}
    given = "--max-num-iterations 3 --pipeline.model.num-downscales 0 robustnerf-data"
    assert record.key == ("desplat", given, str(tmp_path), 42)
    assert record.commit == code_version()


def test_a_run_replaces_an_earlier_one_and_leaves_its_log_where_it_fails(trained, tmp_path: Path):
    earlier = tmp_path / "runs" / "ours-3-42"
    earlier.mkdir(parents=True)
    (earlier / "old.png").touch()
    with pytest.raises(DeSplatError, match="/absent"):
        execute(run_on(None), tmp_path / "runs")
    trained(ValueError("too dark"))
    with pytest.raises(ValueError, match="too dark"):
        execute(run_on(tmp_path), tmp_path / "runs")
    log = (earlier / "run.log").read_text()
    assert "a step" in log and "too dark" in log
    assert [path.name for path in earlier.iterdir()] == ["run.log"]


RUNS = [Run("a", "desplat", (), 9, seed, Path("/photos")) for seed in range(4)]


def failing(run: Run, folder: Path) -> Record:
    if run.seed == 1:
        raise DeSplatError("too dark")
    return made_up(run, folder)


def test_runs_are_recorded_and_those_that_fail_leave_the_others(tmp_path: Path, monkeypatch):
    records = dict[Key, Record]()
    monkeypatch.setattr(module, "execute", failing)
    failed = finish(RUNS, records, tmp_path)
    assert failed == {"a-9-1": "too dark"} and sorted(key[-1] for key in records) == [0, 2, 3]
    assert load(tmp_path / FILE) == records
    monkeypatch.setattr(module, "execute", made_up)
    assert finish(RUNS, records, tmp_path) == {}
    assert [key[-1] for key in load(tmp_path / FILE)][3:] == [1], "nothing is done twice"
