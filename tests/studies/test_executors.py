"""Runs without a record are done and recorded, wherever they are done."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError, DeSplatError
from desplat_ns.studies.executors import Executor, open_records
from desplat_ns.studies.records import FILE, Record, load
from desplat_ns.studies.runs import Run
from tests.helpers.made_up_runs import made_up

RUNS = [Run("a", "desplat", (), 9, seed, Path("/photos")) for seed in range(4)]


def failing(run: Run, folder: Path) -> Record:
    if run.seed == 1:
        raise DeSplatError("too dark")
    return made_up(run, folder)


def test_runs_are_recorded_and_those_that_fail_leave_the_others(tmp_path: Path):
    done = []
    executor = Executor(jobs=2, do=failing)
    failed = executor.finish(RUNS, tmp_path / FILE, tmp_path, lambda run, _: done.append(run.seed))
    assert failed == {"a-9-1": "too dark"} and sorted(done) == [0, 2, 3]
    assert {record.seed for record in load(tmp_path / FILE).values()} == {0, 2, 3}
    again = Executor(do=made_up)
    assert again.finish(RUNS, tmp_path / FILE, tmp_path, lambda run, _: done.append(run.seed)) == {}
    assert done[3:] == [1], "nothing is done twice"


def test_the_next_run_is_asked_for_when_there_is_a_place_for_it(tmp_path: Path):
    """So that who gives the runs may go by the clock."""
    events = []

    def coming():
        for run in RUNS:
            events.append(("asked", run.seed))
            yield run

    def keep(run: Run, record: Record) -> None:
        events.append(("done", run.seed))

    Executor(do=made_up).finish(coming(), tmp_path / FILE, tmp_path, keep)
    assert events == [(what, seed) for seed in range(4) for what in ("asked", "done")]


def test_no_further_run_begins_once_a_record_cannot_be_written(tmp_path: Path, monkeypatch):
    begun = []

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    def do(run: Run, folder: Path) -> Record:
        begun.append(run)
        monkeypatch.setattr("os.fsync", full)
        return made_up(run, folder)

    with pytest.raises(ConfigError, match="No space"):
        Executor(do=do).finish(RUNS, tmp_path / FILE, tmp_path)
    assert len(begun) == 1


def test_a_folder_with_something_else_or_of_other_code_is_refused(tmp_path: Path):
    assert open_records(tmp_path / "new") == {}
    (tmp_path / "photo.png").touch()
    with pytest.raises(ConfigError, match="something else"):
        open_records(tmp_path)
    Executor(do=made_up).finish(RUNS, tmp_path / FILE, tmp_path)
    assert len(open_records(tmp_path)) == 4
    text = (tmp_path / FILE).read_text()
    (tmp_path / FILE).write_text(text.replace('"commit": "', '"commit": "other'))
    with pytest.raises(ConfigError, match="other"):
        open_records(tmp_path)


def test_a_study_without_ray_says_what_to_install(monkeypatch, tmp_path: Path):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(DeSplatError, match=r"desplat-ns\[ray\]"):
        Executor("ray").finish(RUNS, tmp_path / FILE, tmp_path)


def test_ray_gives_what_this_machine_gives(tmp_path: Path):
    pytest.importorskip("ray", reason="Ray is not installed (pip install 'desplat-ns[ray]')")
    failed = Executor("ray", 2, do=failing).finish(RUNS, tmp_path / FILE, tmp_path)
    assert list(failed) == ["a-9-1"] and "too dark" in failed["a-9-1"]
    Executor(do=failing).finish(RUNS, tmp_path / "here.jsonl", tmp_path)
    assert load(tmp_path / FILE) == load(tmp_path / "here.jsonl")
