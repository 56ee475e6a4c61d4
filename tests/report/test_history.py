"""The curves of a run: thinned, and what was done twice counts once."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import ScalarEvent as Scalar

from desplat_ns.report import history
from desplat_ns.report.history import TOTAL_TIME, read_history, scalars, thinned


def test_few_points_stay_as_they_are():
    assert thinned({2: 5.0, 1: 4.0}) == ((1.0, 4.0), (2.0, 5.0))


def test_of_many_points_neighbours_are_averaged():
    assert thinned({step: 2.0 * step for step in range(4)}, most=2) == ((0.5, 1.0), (2.5, 5.0))
    assert len(thinned({step: 1.0 for step in range(30_000)})) <= history.MOST_POINTS


def test_what_cannot_be_drawn_is_left_out():
    values = {0: math.nan, 1: math.inf, 2: 0.0, 3: 1.0}
    assert thinned(values) == ((2.0, 0.0), (3.0, 1.0))
    assert thinned(values, is_logarithmic=True) == ((3.0, 1.0),)


def write_events(folder: Path, logged: Mapping[str, Sequence[Scalar]], text: str = "") -> Path:
    """An event file by TensorBoard's writer."""
    from torch.utils.tensorboard.writer import SummaryWriter

    with SummaryWriter(str(folder)) as writer:
        writer.add_text("config", text)
        for tag, numbers in logged.items():
            for scalar in numbers:
                writer.add_scalar(tag, scalar.value, scalar.step, walltime=scalar.wall_time)
    (path,) = folder.iterdir()
    return path


def test_a_run_that_went_on_has_one_curve_and_the_time_of_both_sessions(tmp_path: Path):
    first = {"Train Loss": [Scalar(10.0 + step, step, 1.0) for step in range(6)]}
    second = {"Train Loss": [Scalar(90.0, step, 2.0) for step in range(4, 8)]}
    second[TOTAL_TIME] = [Scalar(95.0, 8, 30.0)]
    logged = {"1": first, "2": second}
    history = read_history([write_events(tmp_path / name, what) for name, what in logged.items()])
    (chart,) = history.charts
    assert [value for _, value in chart.curves[0].points] == [1.0] * 4 + [2.0] * 4
    assert history.seconds == pytest.approx(5.0 + 30.0)


def test_a_run_that_logged_nothing_has_no_curves(tmp_path: Path):
    assert read_history([]).charts == ()
    assert read_history([tmp_path / "gone"]).seconds is None


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An event file with 50 steps of two numbers, and a text that names one of them."""
    loss = [Scalar(100.0 + step, 1000 * step, 1 / (step + 1)) for step in range(50)]
    other = [Scalar(200.0, step, 7.0) for step in range(50)]
    logged = {"Train Loss": loss, "other": other}
    return write_events(tmp_path_factory.mktemp("events"), logged, "Train Loss, as a text")


def test_the_numbers_of_a_tag_come_in_order_with_step_and_time(written: Path):
    tags = scalars(written, {"Train Loss", "Train"})
    assert set(tags) == {"Train Loss"}
    assert [number.step for number in tags["Train Loss"]] == [1000 * step for step in range(50)]
    values = [number.value for number in tags["Train Loss"]]
    assert values == pytest.approx([1 / (step + 1) for step in range(50)], rel=1e-7)
    assert tags["Train Loss"][3] == Scalar(103.0, 3000, 0.25)


@pytest.mark.parametrize("cut", [1, 11, 30])
def test_a_file_that_is_cut_off_gives_what_is_whole(written: Path, tmp_path: Path, cut: int):
    path = tmp_path / written.name
    path.write_bytes(written.read_bytes()[:-cut])
    tags = scalars(path, {"Train Loss", "other"})
    assert (len(tags["Train Loss"]), len(tags["other"])) == (50, 49)


@pytest.mark.parametrize("content", [b"", b"no records at all", b"\xff" * 400, b"\x00" * 400])
def test_what_is_no_event_file_gives_nothing(written: Path, tmp_path: Path, content: bytes):
    path = tmp_path / written.name
    path.write_bytes(content)
    assert scalars(path, {"Train Loss"}) == {}


def test_damage_ends_the_reading_without_an_error(written: Path, tmp_path: Path):
    whole, path = written.read_bytes(), tmp_path / written.name
    counts = []
    for byte in range(40, len(whole), len(whole) // 20):
        path.write_bytes(whole[:byte] + bytes([whole[byte] ^ 0xFF]) + whole[byte + 1 :])
        tags = scalars(path, {"Train Loss", "other"})
        counts.append(sum(map(len, tags.values())))
    assert counts == sorted(counts) and counts[-1] < 100
