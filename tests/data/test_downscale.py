"""Reduced copies are used where they are whole; nothing is written; no side is ever 0."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from nerfstudio.cameras.cameras import CameraType

from desplat_ns.data.colmap_model import Frame
from desplat_ns.data.downscale import PhotoSource, downscale_factor, photo_sources, reduced_length
from desplat_ns.errors import ConfigError


def frame(name: str, width: int, height: int) -> Frame:
    return Frame(name, 1, np.eye(4)[:3], CameraType.PERSPECTIVE, width, height, {})


@pytest.mark.parametrize(
    ("size", "factor"), [(1600, 1), (1601, 2), (3200, 2), (3201, 4), (48, 1), (6000, 4)]
)
def test_by_itself_the_longest_side_comes_to_at_most_1600(size: int, factor: int):
    assert downscale_factor(None, [frame("a", 10, size), frame("b", 10, 10)]) == factor


@pytest.mark.parametrize("factor", [0, 0.5, -2, float("nan"), float("inf")])
def test_a_factor_below_one_is_an_error(factor: float):
    with pytest.raises(ConfigError, match=r"--downscale-factor is .*2"):
        downscale_factor(factor, [])


def test_lengths_round_as_asked():
    assert [reduced_length(7, 2, mode) for mode in ("floor", "round", "ceil")] == [3, 4, 4]
    assert reduced_length(3, 8, "floor") == 1


def test_without_copies_the_originals_get_the_reduced_size(tmp_path: Path):
    sources, note = photo_sources(tmp_path / "images", [frame("a.png", 9, 7)], 2, "floor")
    assert sources == [PhotoSource(tmp_path / "images" / "a.png", 4, 3)]
    assert "reduced to 1/2" in note
    assert list(tmp_path.iterdir()) == []


def test_copies_are_used_at_their_own_size(tmp_path: Path, photo_writer):
    frames = [frame("a.png", 9, 7), frame("b.png", 9, 7)]
    for photo in frames:
        photo_writer(tmp_path / "images_2" / photo.name, 5, 4)  # rounded up by who made them
    sources, note = photo_sources(tmp_path / "images", frames, 2, "floor")
    assert sources == [PhotoSource(tmp_path / "images_2" / f.name, 5, 4) for f in frames]
    assert str(tmp_path / "images_2") in note


@pytest.mark.parametrize("fault", ["missing", "size"])
def test_an_incomplete_or_wrong_folder_of_copies_is_not_used(tmp_path, photo_writer, fault: str):
    frames = [frame("a.png", 9, 7), frame("b.png", 9, 7)]
    photo_writer(tmp_path / "images_2" / "a.png", 4, 3)
    if fault == "size":
        photo_writer(tmp_path / "images_2" / "b.png", 9, 7)
    sources, note = photo_sources(tmp_path / "images", frames, 2, "floor")
    assert {source.path.parent for source in sources} == {tmp_path / "images"}
    assert "has 1 of 2" in note


def test_at_full_size_nothing_is_said(tmp_path: Path):
    sources, note = photo_sources(tmp_path, [frame("a.png", 9, 7)], 1, "floor")
    assert (sources[0].width, sources[0].height, note) == (9, 7, "")
