"""Reduced copies are used where they are whole; nothing is written; no side is ever 0."""

from pathlib import Path

import numpy as np
import pytest
from nerfstudio.cameras.cameras import CameraType

from desplat_ns.data.downscale import PhotoSource, downscale_factor, photo_sources, reduced_length
from desplat_ns.data.reconstruction import Frame
from tests.helpers.files import touch


def frame(name: str, width: int, height: int) -> Frame:
    return Frame(name, 1, np.eye(4)[:3], CameraType.PERSPECTIVE, width, height, {})


@pytest.mark.parametrize(
    ("size", "factor"), [(1600, 1), (1601, 2), (3200, 2), (3201, 4), (48, 1), (6000, 4)]
)
def test_by_itself_the_longest_side_comes_to_at_most_1600(size: int, factor: int):
    assert downscale_factor(None, frame("a", 10, size)) == factor


def test_lengths_round_as_asked():
    assert [reduced_length(7, 2, mode) for mode in ("floor", "round", "ceil")] == [3, 4, 4]
    assert reduced_length(3, 8, "floor") == 1


@pytest.mark.parametrize("fault", ["", "missing", "size"])
def test_copies_are_used_at_their_own_size_if_they_fit(
    tmp_path: Path, photo_writer, fault: str, capsys
):
    frames = [frame("a.png", 9, 7), frame("b.png", 9, 7)]
    copies = tmp_path / "images_2"
    photo_writer(copies / "a.png", 5, 4)  # rounded up by who made them
    if fault != "missing":
        photo_writer(copies / "b.png", *((9, 7) if fault == "size" else (5, 4)))
    if fault:
        touch(tmp_path, "images/b.png")
    before = sorted(tmp_path.rglob("*"))
    sources = photo_sources(tmp_path / "images", frames, 2, "floor")
    other = PhotoSource(tmp_path / "images" / "b.png", 4, 3)
    second = other if fault else PhotoSource(copies / "b.png", 5, 4)
    assert sources == [PhotoSource(copies / "a.png", 5, 4), second]
    said = capsys.readouterr().out
    assert f"{1 if fault else 2} of them are read in smaller copies" in said
    assert sorted(tmp_path.rglob("*")) == before


def test_without_copies_or_at_full_size_the_originals_are_used(tmp_path: Path):
    touch(tmp_path, "i/a.png")
    for factor, size in ((1, (9, 7)), (2, (4, 3))):
        sources = photo_sources(tmp_path / "i", [frame("a.png", 9, 7)], factor, "floor")
        assert sources == [PhotoSource(tmp_path / "i" / "a.png", *size)]
    assert list(tmp_path.iterdir()) == [tmp_path / "i"]
