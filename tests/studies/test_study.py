"""A study from end to end, with runs that are made up: failures, sessions."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError, DeSplatError
from desplat_ns.settings.effects import Effects
from desplat_ns.studies import study as module
from desplat_ns.studies.executors import Executor
from desplat_ns.studies.methods import Content
from desplat_ns.studies.plan import Capture
from desplat_ns.studies.records import FILE, Record, load
from desplat_ns.studies.report import write_report
from desplat_ns.studies.runs import Run
from desplat_ns.studies.study import Request, Study, do_study, open_study
from tests.helpers.made_up_runs import made_up

pytestmark = pytest.mark.usefixtures("tyro_may_build")


@dataclass
class Time:
    """A clock that made-up runs set forward."""

    now: float = 0.0
    failing: str = "nothing"
    """How names of runs begin that fail."""
    done: list[str] = field(default_factory=list)

    def monotonic(self) -> float:
        return self.now

    def do(self, run: Run, folder: Path) -> Record:
        self.done.append(run.name)
        record = made_up(run, folder)
        self.now += record.seconds
        if run.name.startswith(self.failing):
            raise DeSplatError("too dark")
        return record


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> Time:
    clock = Time()

    def described(data: Path, parser: tuple[str, ...]) -> Capture:
        return Capture(data, parser, Content(20, 3, 120, 80, 500), Effects())

    monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(module, "describe_capture", described)
    return clock


Sit = Callable[..., Study]


@pytest.fixture
def sit(time: Time, tmp_path: Path) -> Sit:
    """A session of so many seconds in all."""

    def session(seconds: float, data: str = "/photos/garden") -> Study:
        time.done.clear()
        request = Request(Path(data), ("colmap",), tmp_path, seconds, Executor(do=time.do))
        study = open_study(request)
        do_study(study, lambda what: None)
        return study

    return session


def test_runs_end_up_in_the_file_and_the_report(sit: Sit, time: Time, tmp_path: Path):
    study = sit(7200.0)
    assert study.failed == {} and study.spent <= 7200.0
    assert len(load(tmp_path / FILE)) == len(time.done) > 20
    assert {record.seed for record in study.records.values()} == {42, 43, 44}
    report = write_report(study).read_text()
    assert "garden" in report and "p &lt; 0.001" in report
    outside = re.findall(r"<script|<link|(?:src|href)=.(?!data:|#)", report)
    assert outside == [], "the page needs no other file"
    assert (tmp_path / "training.svg").stat().st_size > 1000


def test_a_run_that_fails_is_reported_and_the_rest_goes_on(sit: Sit, time: Time):
    time.failing = "fewer-"
    study = sit(3600.0)
    assert study.failed and set(study.failed.values()) == {"too dark"}
    assert len(study.records) == len(time.done) - len(study.failed) > 10
    assert "too dark" in write_report(study).read_text()


def test_a_study_whose_first_run_fails_ends_with_its_reason(sit: Sit, time: Time):
    time.failing = ""
    with pytest.raises(DeSplatError, match="too dark"):
        sit(600.0)


def test_another_session_goes_on_with_what_is_missing(sit: Sit, time: Time):
    first = sit(600.0)
    before = list(time.done)
    assert first.left_out
    again = sit(600.0)
    assert time.done == [] and [r.key for r in again.planned] == [r.key for r in first.planned]
    assert again.spent == pytest.approx(first.spent), "earlier sessions count"
    sit(1200.0)
    assert time.done and not set(time.done) & set(before)


def test_a_study_of_another_capture_is_not_gone_on_with(sit: Sit):
    sit(600.0)
    with pytest.raises(ConfigError, match="/photos/garden"):
        sit(600.0, "/photos/castle")
