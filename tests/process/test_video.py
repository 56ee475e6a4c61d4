"""Frames of a real video, written and read by ffmpeg."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from desplat_ns.data.images import read_image
from desplat_ns.errors import CaptureError
from desplat_ns.process.video import look_at, take_frames
from tests.helpers.yard import BLUR, FRAMES_OF_A_VIEW, Yard, silent, view_of


@pytest.fixture(scope="module")
def film(yard: Yard, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return yard.film(tmp_path_factory.mktemp("film") / "walk.mp4")


@pytest.mark.slow
def test_frames_that_are_taken_are_the_sharp_ones_of_their_numbers(
    film: Path, yard: Yard, tmp_path: Path
):
    """Each looks more like its view than like any other, and than like its view blurred."""
    names = take_frames(film, tmp_path, 150, silent)
    candidates = [*yard.pictures, *(cv2.GaussianBlur(p, (0, 0), BLUR) for p in yard.pictures)]
    for name in names:
        frame = read_image(tmp_path / name).astype(float)
        off = [np.abs(frame - candidate).mean() for candidate in candidates]
        assert int(np.argmin(off)) == view_of(name)


@pytest.mark.slow
def test_every_frame_is_looked_at_and_progress_ends_at_their_number(film: Path, yard: Yard):
    reports: list[tuple[int, int]] = []
    frames = list(look_at(film, lambda done, total: reports.append((done, total))))
    assert [frame.index for frame in frames] == list(range(FRAMES_OF_A_VIEW * len(yard.pictures)))
    assert reports[-1] == (len(frames), len(frames))


@pytest.mark.slow
def test_no_more_frames_are_taken_than_are_asked_for(film: Path, tmp_path: Path):
    assert len(take_frames(film, tmp_path, 4, silent)) <= 4


@pytest.mark.slow
def test_a_video_whose_camera_stands_still_is_refused(yard: Yard, tmp_path: Path):
    still = Yard([yard.pictures[0]] * 12, yard.centres, yard.pixel)
    with pytest.raises(CaptureError, match="walk around while filming"):
        take_frames(still.film(tmp_path / "still.mp4"), tmp_path / "frames", 150, silent)
    assert not (tmp_path / "frames").exists()


def test_what_is_no_video_is_refused(tmp_path: Path):
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"no video")
    with pytest.raises(CaptureError, match=r"broken\.mp4 cannot be read"):
        take_frames(broken, tmp_path / "frames", 150, silent)
