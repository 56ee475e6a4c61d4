"""A study from end to end, with trainings that are made up: failures, sessions."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.studies import pace, study
from desplat_ns.studies.pace import Pace
from desplat_ns.studies.report import write_report
from desplat_ns.studies.results import FILE, Results
from desplat_ns.studies.study import Request, Session, open_study
from tests.helpers.tradeoff import CAPTURE, MadeUpExecutor, failing, made_up

pytestmark = pytest.mark.usefixtures("tyro_may_build")


@dataclass
class Time:
    """A clock that made-up work sets forward."""

    now: float = 0.0

    def monotonic(self) -> float:
        return self.now

    def wait(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> Time:
    clock = Time()
    monkeypatch.setattr(pace.Clock, "_now", staticmethod(clock.monotonic))
    monkeypatch.setattr(study, "first_pace", lambda capture, device: Pace(0.08))
    return clock


def sit(folder: Path, time: Time, seconds: float, outcome=None) -> tuple[Session, MadeUpExecutor]:
    executor = MadeUpExecutor(time.wait)
    if outcome is not None:
        executor.outcome = outcome
    request = Request(Path(CAPTURE.data), CAPTURE.parser, folder, seconds, 1, executor)
    results = Results.load(folder) or Results(CAPTURE)
    session = Session(request, results, lambda what: None)
    session.do()
    return session, executor


@pytest.mark.slow
def test_trainings_end_up_in_the_file_and_the_report(time, tmp_path):
    session, executor = sit(tmp_path, time, 7200.0)
    written = json.loads((tmp_path / FILE).read_text())
    assert written["failed"] == {}
    assert set(written["training"]) == {run.name for run in executor.done}
    assert written["spent"] <= 7200.0
    assert session.results.plan is not None and session.results.plan.steps >= 500
    assert {run.seed for run in executor.done} == {42, 43, 44}
    report = write_report(tmp_path, session.results).read_text()
    assert "garden: what accuracy costs in time" in report
    assert "paired t-test" in report and "p &lt; 0.001" in report
    outside = re.findall(r"<script|<link|(?:src|href)=.(?!data:|#)", report)
    assert outside == [], "the page needs no other file"
    for name in ("training", "ssim"):
        assert (tmp_path / f"{name}.svg").stat().st_size > 1000
        assert (tmp_path / f"{name}.png").stat().st_size > 1000


@pytest.mark.slow
def test_a_training_that_fails_is_reported_and_the_rest_goes_on(time, tmp_path):
    session, executor = sit(tmp_path, time, 1800.0, failing("fewer-"))
    failed = [name for name in session.results.failed if name.startswith("fewer-")]
    assert failed and all(session.results.failed[name] == "too dark" for name in failed)
    assert len(session.results.training) == len(executor.done) - len(failed) > 10
    report = write_report(tmp_path, session.results).read_text()
    assert "too dark" in report


def test_a_study_of_which_every_training_fails_still_has_a_report(time, tmp_path):
    session, executor = sit(tmp_path, time, 600.0, failing(""))
    assert executor.done and not session.results.training
    report = write_report(tmp_path, session.results).read_text()
    assert "No training was measured" in report and "too dark" in report


def test_another_sitting_goes_on_with_what_is_missing(time, tmp_path):
    first, before = sit(tmp_path, time, 600.0)
    assert first.results.left_out
    again, nothing = sit(tmp_path, time, 600.0)
    assert nothing.done == [] and again.results.plan == first.results.plan
    assert again.clock.spent == pytest.approx(first.clock.spent), "earlier sessions count"
    more, after = sit(tmp_path, time, 1200.0)
    assert after.done and not set(after.done) & set(before.done)
    assert len(more.results.left_out) < len(first.results.left_out)


def test_a_full_disk_ends_a_study_with_what_to_do(time, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    def fail_later(run):
        monkeypatch.setattr("os.fsync", full)
        return made_up(run)

    with pytest.raises(ConfigError, match="Make room"):
        sit(tmp_path, time, 600.0, fail_later)
    monkeypatch.undo()
    assert Results.load(tmp_path) is not None, "what was there can be gone on with"


def test_a_report_that_cannot_be_written_says_what_to_do(time, tmp_path):
    session, _ = sit(tmp_path, time, 600.0)
    (tmp_path / "report.html").mkdir()
    with pytest.raises(ConfigError, match="--output"):
        write_report(tmp_path, session.results)


def test_too_little_time_for_one_training_is_refused(time, tmp_path):
    with pytest.raises(ConfigError, match="Give --time"):
        sit(tmp_path, time, 10.0)


def test_a_study_of_another_capture_is_not_gone_on_with(tmp_path):
    Results(CAPTURE).save(tmp_path)
    executor = MadeUpExecutor(lambda seconds: None)
    other = Request(Path("/photos/castle"), CAPTURE.parser, tmp_path, 60.0, 1, executor)
    with pytest.raises(ConfigError, match="the study of another capture"):
        open_study(other)
    same = replace(other, data=Path(CAPTURE.data))
    assert open_study(same).capture == CAPTURE
