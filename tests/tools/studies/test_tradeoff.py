"""A study of a capture with made-up runs: what fits into the time, and sessions."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from desplat_ns.core.effects import Effects
from desplat_ns.core.errors import ConfigError, DeSplatError
from desplat_ns.tools.studies import runs
from desplat_ns.tools.studies import tradeoff as module
from desplat_ns.tools.studies.methods import parse
from desplat_ns.tools.studies.records import FILE, Record, load, open_records
from desplat_ns.tools.studies.runs import Run
from desplat_ns.tools.studies.tradeoff import BASE, SEEDS, Study, compared, gain, write_page
from tests.helpers.made_up_runs import made_up

pytestmark = pytest.mark.usefixtures("tyro_may_build")


def study_of(seconds: float, records=None, output: Path = Path()) -> Study:
    capture = Path("/photos/garden"), ("colmap",), "20 photos train", Effects()
    return Study(*capture, output, seconds, records or {})


@pytest.mark.slow
@pytest.mark.parametrize(
    "base", [Effects(), Effects(False, "camera", "image"), Effects(True, "affine", "sh")]
)
def test_variants_differ_from_the_base_in_one_thing_and_the_method_takes_them(base: Effects):
    """And photos of a light of their own are scored in it."""
    options = {}
    for name, (_, words) in compared(base).items():
        options[name] = dict(zip(words[::2], words[1::2], strict=True))
        config = parse("desplat", words)
        light = config.pipeline.model.effects.settled().image_light
        assert config.pipeline.evaluation.protocol == ("half" if light else "right")
    theirs = options.pop(BASE)
    for name, ours in options.items():
        changed = {k for k in ours if ours[k] != theirs.get(k)} - {"--pipeline.evaluation.protocol"}
        assert len(changed) == 1, name


def test_every_variant_is_compared_at_one_length_after_the_other_and_then_with_other_seeds():
    runs, count = study_of(0.0).plan(500), len(compared(Effects()))
    lengths = [run.steps for run in runs[::count]]
    assert lengths == [125, 250, 500, 500, 500, 250, 250, 125, 125]
    assert {run.seed for run in runs[: 3 * count]} == {SEEDS[0]}
    assert len({run.key for run in runs}) == len(runs) == 9 * count


@dataclass
class Time:
    """A clock that made-up runs set forward."""

    now: float = 0.0
    failing: str = "nothing"
    """How names of runs begin that fail."""
    done: list[str] = field(default_factory=list)

    def monotonic(self) -> float:
        return self.now

    def execute(self, run: Run, folder: Path) -> Record:
        self.done.append(run.name)
        record = made_up(run, folder)
        self.now += record.seconds
        if run.name.startswith(self.failing):
            raise DeSplatError("too dark")
        return record


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> Time:
    clock = Time()
    monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(runs, "execute", clock.execute)
    return clock


Sit = Callable[[float], Study]


@pytest.fixture
def sit(time: Time, tmp_path: Path) -> Sit:
    """A session of a number of seconds in all."""

    def session(seconds: float) -> Study:
        time.done.clear()
        study = study_of(seconds, open_records(tmp_path), tmp_path)
        study.do()
        assert study.spent <= seconds
        return study

    return session


@pytest.mark.slow
def test_runs_end_up_in_the_file_and_the_page(sit: Sit, time: Time, tmp_path: Path):
    time.failing = "fewer-"
    study = sit(7200.0)
    assert set(study.failed.values()) == {"too dark"}
    assert len(load(tmp_path / FILE)) == len(time.done) - len(study.failed) > 20
    assert {record.seed for record in study.records.values()} >= {42, 43}
    page = write_page(study).read_text()
    assert "garden" in page and "too dark" in page
    outside = re.findall(r"<script|<link|(?:src|href)=.(?!data:|#)", page)
    assert outside == [], "the page needs no other file"
    assert "<img" in page


@pytest.mark.slow
def test_another_session_goes_on_with_what_is_missing(sit: Sit, time: Time, tmp_path: Path):
    first = sit(600.0)
    before = list(time.done)
    assert len(first.records) < len(first.planned), "time is over"
    again = sit(600.0)
    assert time.done == []
    assert again.spent == pytest.approx(first.spent), "earlier sessions count"
    sit(1200.0)
    assert time.done and not set(time.done) & set(before)
    with pytest.raises(ConfigError, match="/photos/garden"):
        module.open_study(Path("/photos/castle"), (), tmp_path, 600.0)


def test_a_difference_is_of_the_same_seeds_and_steps():
    def scores(*psnr: float) -> dict[int, dict[str, float]]:
        return {seed: {"psnr": value} for seed, value in zip(SEEDS, psnr, strict=False)}

    points = {(BASE, 100): scores(20.0, 20.1, 20.2), ("a", 100): scores(20.3, 20.5, 20.4)}
    points |= {("b", 100): scores(25.0), ("c", 200): scores(20.0)}
    said = [gain(points, point) for point in points]
    assert said == ["", "+0.30 (+0.20 to +0.40)", "+5.00", ""]
