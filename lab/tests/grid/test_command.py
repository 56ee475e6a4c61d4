"""The command of a study does what is missing, and nothing else."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.errors import DeSplatError
from desplat_ns.studies import executors as module
from desplat_ns.studies.machine import DIRTY
from desplat_ns.studies.runs import Record as Measured
from desplat_ns.studies.runs import Run as Job
from desplat_ns.studies.runs import log_of
from lab.grid import records
from lab.grid.captures import RealCapture
from lab.grid.command import Command, named_runs
from lab.grid.records import Record, load, save
from lab.grid.runs import Run, Scene, Setting, Study
from tests.helpers.other_process import running, tried


class Here(RealCapture):
    """A capture that is there."""

    def locate(self, folder: Path) -> Path:
        return folder


CAPTURE = Here("fox")
FOUND = Measured({"psnr": 30.0, "ssim": 0.5}, "new")
PLAN = tuple(
    Run(name, scene, 1, 1000, seed)
    for seed in (42, 43)
    for scene in ("yard", "yard8")
    for name in ("off", "ours")
)
STUDY = Study(
    {"off": Setting("a"), "ours": Setting("b", ("--steep", "2"))},
    {"yard": Scene(CAPTURE, ()), "yard8": Scene(CAPTURE, ())},
    PLAN,
    ("psnr",),
)
DONE, DIRTY_CODE, DONE_TOO, MISSING = PLAN[:4]


@pytest.fixture
def command(tmp_path: Path, monkeypatch) -> Command:
    """A study with two runs that are done, and one of code that was not committed."""
    file = tmp_path / "records.json"
    figures = {"psnr": 20.0}
    save(
        file,
        {
            DONE.name: Record(figures, "c", "a"),
            DIRTY_CODE.name: Record(figures, "c" + DIRTY, "b"),
            DONE_TOO.name: Record(figures, "c", "as it was given then"),
        },
    )
    monkeypatch.setattr(module, "execute", lambda *_: FOUND)
    return Command(STUDY, file, lambda: tmp_path / "page.md", tmp_path / "out", "study", "")


def test_the_list_names_what_is_to_be_done(command: Command, capsys):
    assert command.main(["--list", "--only", "*-42"]) == 0
    assert capsys.readouterr().out.splitlines() == [DIRTY_CODE.name, MISSING.name]
    assert not command.output.exists()


def test_what_is_to_be_done_is_done_and_recorded(command: Command, capsys):
    assert command.main(["--only", "*-42", "--jobs", "2"]) == 0
    entries = load(command.file)
    assert entries[DONE.name].figures == {"psnr": 20.0}
    assert entries[DONE_TOO.name].given == "as it was given then"
    for run in (DIRTY_CODE, MISSING):
        assert entries[run.name] == Record({"psnr": 30.0}, "new", "b --steep 2")
    assert len(entries) == 4
    assert "page.md" in capsys.readouterr().out


def test_a_record_that_cannot_be_written_leaves_the_other_runs(command, monkeypatch, capsys):
    enter = records.enter

    def full_for_one(file: Path, run: Run, record: Record) -> None:
        if run == DIRTY_CODE:
            raise OSError("No space left on device")
        enter(file, run, record)

    monkeypatch.setattr(records, "enter", full_for_one)
    assert command.main(["--only", "*-42"]) == 1
    entries = load(command.file)
    assert entries[DIRTY_CODE.name].figures == {"psnr": 20.0}
    assert entries[MISSING.name].figures == {"psnr": 30.0}
    assert f"{DIRTY_CODE.name}: OSError: No space left" in capsys.readouterr().err


def test_a_report_alone_runs_nothing(command: Command, monkeypatch):
    before = load(command.file)
    assert command.main(["--report"]) == 0
    assert load(command.file) == before


def test_a_run_that_fails_is_said_and_leaves_the_others(command: Command, monkeypatch, capsys):
    def fail(job: Job, folder: Path, *_: Any) -> Measured:
        if job.name == DIRTY_CODE.name:
            raise DeSplatError("no disk")
        return FOUND

    monkeypatch.setattr(module, "execute", fail)
    assert command.main(["--only", "*-42"]) == 1
    assert f"{DIRTY_CODE.name}: no disk" in capsys.readouterr().err
    assert MISSING.name in load(command.file)


def test_any_exception_is_a_failed_run_and_its_log_is_named(command: Command, monkeypatch, capsys):
    def fail(job: Job, folder: Path, *_: Any) -> Measured:
        if job.name == DIRTY_CODE.name:
            raise OSError("disk full")
        return FOUND

    monkeypatch.setattr(module, "execute", fail)
    assert command.main(["--only", "*-42"]) == 1
    said = capsys.readouterr().err
    assert f"{DIRTY_CODE.name}: OSError: disk full" in said
    assert str(log_of(DIRTY_CODE.name, command.output)) in said
    assert MISSING.name in load(command.file)


@pytest.mark.parametrize("more", [[], ["--list"]])
def test_a_pattern_that_names_no_run_is_an_error(command: Command, capsys, more: list[str]):
    assert command.main(["--only", "off-*", "of-yard-1-1000-42", *more]) == 1
    printed = capsys.readouterr()
    assert "No run of the study is named 'of-yard-1-1000-42'" in printed.err
    assert "off-yard-1-1000-42" in printed.err
    assert "written" not in printed.out and len(load(command.file)) == 3


def test_a_pattern_names_runs_by_their_name_or_how_it_begins():
    assert named_runs(STUDY, ["*-yard"]) == [run for run in PLAN if run.scene == "yard"]
    assert named_runs(STUDY, [PLAN[3].name, "off-*-42"]) == [PLAN[3], PLAN[0], PLAN[2]]


def test_while_a_study_runs_no_other_process_writes_its_records_or_into_its_folder(
    command: Command, checkout: Path, monkeypatch, capsys
):
    locks = [f"only_process_writing(Path({str(command.file)!r}))"]
    locks += [f"only_process_in(Path({str(command.output)!r}))"]
    tries: list[str] = []

    def execute(*_: object) -> Measured:
        tries.extend(tried(lock, checkout) for lock in locks)
        return FOUND

    monkeypatch.setattr(module, "execute", execute)
    assert command.main(["--only", DIRTY_CODE.name]) == 0
    assert len(tries) == 2 and all(f"Process {os.getpid()} is at work in" in line for line in tries)
    assert [tried(lock, checkout) for lock in locks] == ["free", "free"]


def test_a_second_study_with_the_same_records_is_refused(
    command: Command, checkout: Path, tmp_path: Path, capsys
):
    code = "from pathlib import Path; from desplat_ns.files.lock import *\n"
    code += f"with only_process_writing(Path({str(command.file)!r})):\n    wait()"
    before = command.file.read_text()
    with running(code, checkout) as first:
        assert command.main(["--only", DIRTY_CODE.name, "--output", str(tmp_path / "other")]) == 1
        assert f"Error: Process {first.pid} is at work in '{tmp_path}'" in capsys.readouterr().err
        assert command.main(["--list"]) == 0, "looking is free"
    assert command.file.read_text() == before
