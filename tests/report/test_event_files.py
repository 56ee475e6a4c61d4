"""Numbers in event files: what TensorBoard wrote is what is read."""

from pathlib import Path

import pytest

from desplat_ns.report.event_files import Scalar, scalars


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An event file by TensorBoard: 50 steps of two numbers, and a text."""
    from torch.utils.tensorboard.writer import SummaryWriter

    folder = tmp_path_factory.mktemp("events")
    with SummaryWriter(str(folder)) as writer:
        writer.add_text("config", "Train Loss, as a text")
        for step in range(50):
            writer.add_scalar("Train Loss", 1 / (step + 1), step * 1000, walltime=100.0 + step)
            writer.add_scalar("other", 7.0, step)
    (path,) = folder.iterdir()
    return path


def test_the_numbers_of_a_tag_come_in_order_with_step_and_time(written: Path):
    found = list(scalars(written, {"Train Loss"}))
    assert [one.step for one in found] == [1000 * step for step in range(50)]
    assert [one.value for one in found] == pytest.approx([1 / (s + 1) for s in range(50)], rel=1e-7)
    assert found[3] == Scalar("Train Loss", 3000, 0.25, 103.0)


def test_a_tag_that_nobody_logged_has_no_numbers(written: Path):
    assert list(scalars(written, {"Train"})) == []


@pytest.mark.parametrize("cut", [1, 11, 30])
def test_a_file_that_is_cut_off_gives_what_is_whole(written: Path, tmp_path: Path, cut: int):
    path = tmp_path / "cut"
    path.write_bytes(written.read_bytes()[:-cut])
    assert len(list(scalars(path, {"Train Loss", "other"}))) == 99


@pytest.mark.parametrize("content", [b"", b"no records at all", b"\xff" * 400, b"\x00" * 400])
def test_what_is_no_event_file_gives_nothing(tmp_path: Path, content: bytes):
    path = tmp_path / "other"
    path.write_bytes(content)
    assert list(scalars(path, {"Train Loss"})) == []


@pytest.mark.parametrize("byte", range(40, 400, 7))
def test_damage_ends_the_reading_without_an_error(written: Path, tmp_path: Path, byte: int):
    damaged = bytearray(written.read_bytes())
    damaged[byte] ^= 0xFF
    path = tmp_path / "damaged"
    path.write_bytes(damaged)
    assert len(list(scalars(path, {"Train Loss", "other"}))) <= 100
