"""What is read back of a run: curves, cost, effects with their reasons."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from tensorboard.backend.event_processing.event_accumulator import ScalarEvent as Scalar

from desplat_ns.report.recorded import (
    MOST_POINTS,
    effect_reasons,
    read_history,
    read_survey,
    scalars,
    thinned,
)
from desplat_ns.settings.effects import Effects


def test_of_many_points_neighbours_are_averaged_and_few_stay_as_they_are():
    assert thinned({2: 5.0, 1: 4.0}) == ((1.0, 4.0), (2.0, 5.0))
    assert thinned({step: 2.0 * step for step in range(4)}, most=2) == ((0.5, 1.0), (2.5, 5.0))
    assert len(thinned({step: 1.0 for step in range(30_000)})) <= MOST_POINTS


def test_what_cannot_be_drawn_is_left_out():
    values = {0: math.nan, 1: math.inf, 2: 0.0, 3: 1.0}
    assert thinned(values) == ((2.0, 0.0), (3.0, 1.0))
    assert thinned(values, is_logarithmic=True) == ((3.0, 1.0),)


def write_events(folder: Path, logged: Mapping[str, Sequence[Scalar]]) -> Path:
    """An event file by TensorBoard's writer, with a text that names a tag."""
    from torch.utils.tensorboard.writer import SummaryWriter

    with SummaryWriter(str(folder)) as writer:
        writer.add_text("config", "Train Loss, as a text")
        for tag, numbers in logged.items():
            for scalar in numbers:
                writer.add_scalar(tag, scalar.value, scalar.step, walltime=scalar.wall_time)
    (path,) = folder.iterdir()
    return path


def test_a_run_that_went_on_has_one_curve_and_the_time_of_both_sessions(tmp_path: Path):
    first = {"Train Loss": [Scalar(10.0 + step, step, 1.0) for step in range(6)]}
    second = {"Train Loss": [Scalar(90.0, step, 2.0) for step in range(4, 8)]}
    second["Train Loss"].append(Scalar(95.0, 8, 2.0))
    logged = {"1": first, "2": second}
    files = [write_events(tmp_path / name, what) for name, what in logged.items()]
    (chart,), seconds = read_history(files)
    (points,) = chart.curves.values()
    assert [value for _, value in points] == [1.0] * 4 + [2.0] * 5
    assert seconds == pytest.approx(5.0 + 5.0)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An event file with 50 steps of two numbers."""
    loss = [Scalar(100.0 + step, 1000 * step, 1 / (step + 1)) for step in range(50)]
    other = [Scalar(200.0, step, 7.0) for step in range(50)]
    return write_events(tmp_path_factory.mktemp("events"), {"Train Loss": loss, "other": other})


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_file_that_is_cut_off_or_damaged_gives_what_stands_before(
    written: Path, tmp_path: Path, share: float
):
    whole, path = written.read_bytes(), tmp_path / written.name
    at = int(share * len(whole))
    for content in (whole[:at], whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :]):
        path.write_bytes(content)
        read = sum(map(len, scalars(path, {"Train Loss", "other"}).values()))
        assert 100 * (share - 0.3) <= read < 100


def finding(decision: Any, confidence: str) -> dict[str, Any]:
    return {"decision": decision, "confidence": confidence, "reason": "Because."}


SURVEY = {"appearance": finding("camera", "close"), "background": finding("off", "none")}


def test_an_effect_has_the_surveys_reason():
    effects = Effects(True, "camera", "off")
    distractors, appearance, background = effect_reasons(effects, SURVEY, 29, ["a.jpg", "b.jpg"])
    assert (distractors.value, appearance.value, background.value) == ("on", "camera", "off")
    assert "2 of 29" in distractors.why and "a.jpg, b.jpg" in distractors.why
    assert appearance.why.startswith("Because.") and "close call" in appearance.why
    assert "safe side" in background.why


def test_an_effect_that_was_given_against_the_survey_says_so():
    distractors, appearance, _ = effect_reasons(Effects(False, "affine"), SURVEY, 29, [])
    assert (distractors.value, appearance.value) == ("off", "affine")
    assert "would have said camera: Because." in appearance.why


@pytest.mark.parametrize("content", ["", "{"])
def test_findings_that_cannot_be_read_are_none(tmp_path: Path, content: str):
    path = tmp_path / "survey.json"
    path.write_text(content)
    assert read_survey(path) is None
    assert read_survey(tmp_path / "gone.json") is None
    path.write_text(json.dumps(SURVEY))
    assert read_survey(path) == SURVEY
