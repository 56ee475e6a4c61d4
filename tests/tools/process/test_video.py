"""Frames of a real video, written and read by ffmpeg."""

import subprocess
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.images import read_image
from desplat_ns.tools.process.request import Request
from desplat_ns.tools.process.video import FAR, motion, pixel_aspect, take_frames
from tests.helpers.yard import BLUR, SIZE, Yard, view_of

pytestmark = pytest.mark.slow


def test_frames_that_are_taken_are_the_sharp_ones_of_their_numbers(yard: Yard, tmp_path: Path):
    """Each looks more like its view than like any other, and than like its view blurred."""
    film = yard.film(tmp_path / "walk.mp4")
    names = take_frames(film, tmp_path / "frames", 150)
    candidates = [*yard.pictures, *(cv2.GaussianBlur(p, (0, 0), BLUR) for p in yard.pictures)]
    for name in names:
        frame = read_image(tmp_path / "frames" / name).astype(float)
        off = [np.abs(frame - candidate).mean() for candidate in candidates]
        assert int(np.argmin(off)) == view_of(name)
    assert take_frames(film, tmp_path / "frames", 150) == names
    assert len(take_frames(film, tmp_path / "few", 4)) <= 4


@pytest.mark.parametrize("views", [1, 12], ids=["three frames", "all the same"])
def test_a_video_whose_camera_stands_still_is_refused_and_leaves_nothing(
    yard: Yard, tmp_path: Path, views: int
):
    """Else the next video is refused there."""
    still = Yard([yard.pictures[0]] * views, yard.centres, yard.pixel)
    film = still.film(tmp_path / "FILM Ä 1.MP4")
    with pytest.raises(CaptureError, match=rf"FILM Ä 1\.MP4 has {3 * views} frames"):
        Request(film, tmp_path / "out").main()
    assert not (tmp_path / "out").exists()


def test_a_thing_that_moves_before_a_plain_wall_is_seen_to_move():
    wall = np.full((180, 320), 128, np.uint8)
    thing = np.random.default_rng(0).integers(0, 256, (110, 130), np.uint8)
    first, second = wall.copy(), wall.copy()
    first[40:150, 90:220] = second[40:150, 98:228] = cv2.GaussianBlur(thing, (0, 0), 2)
    assert motion(first, second) == pytest.approx(8 / 320, rel=0.2)


def test_between_frames_that_share_nothing_the_picture_moved_far():
    noise = np.random.default_rng(0).integers(0, 256, (2, 18, 32), dtype=np.uint8)
    first, second = (cv2.resize(one, (320, 180), interpolation=cv2.INTER_CUBIC) for one in noise)
    assert motion(first, second) == FAR and motion(first, first) < 1e-6


@pytest.mark.parametrize("aspect", [(4, 3), (3, 4)])
def test_pixels_of_a_video_become_square(yard: Yard, tmp_path: Path, aspect: tuple[int, int]):
    """Squeezed when the film was made, frames are as the views again; turned, other sides are."""
    wide, high = aspect
    narrow = SIZE[0] * min(1, high / wide), SIZE[1] * min(1, wide / high)
    squeeze = f"scale={narrow[0]:.0f}:{narrow[1]:.0f},setsar={wide}/{high}"
    film = yard.film(tmp_path / "film.mp4", ("-vf", squeeze))
    names = take_frames(film, tmp_path / "frames", 150)
    for name in names:
        frame = read_image(tmp_path / "frames" / name).astype(float)
        off = [np.abs(frame - view).mean() for view in yard.pictures]
        assert int(np.argmin(off)) == view_of(name)
    turned = tmp_path / "turned.mp4"
    program = imageio_ffmpeg.get_ffmpeg_exe()
    line = [program, "-display_rotation", "90", "-i", str(film), "-c", "copy", str(turned)]
    subprocess.run(line, check=True, capture_output=True)
    assert pixel_aspect(film) == pytest.approx(wide / high)
    assert pixel_aspect(turned) == pytest.approx(high / wide)


def test_what_is_no_video_is_refused(tmp_path: Path):
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"no video")
    with pytest.raises(CaptureError, match=r"broken\.mp4"):
        take_frames(broken, tmp_path / "frames", 150)
