"""What captures may be like: what is missing, broken or masked, kinds of files, few photos."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.images import read_image
from desplat_ns.data.reconstruction import TRACKS
from desplat_ns.survey.survey import mismatch_of, survey
from lab.pictures import write_image
from tests.helpers.surveyed import copied, points_of, some, with_points

OFF = {"appearance": "off", "background": "off"}


@pytest.mark.slow
def test_without_tracks_patches_stand_for_them(make_capture):
    capture = make_capture(cluttered=True)
    result = survey(with_points(capture, points_of(capture), tracks=None))
    assert result.decisions() == OFF
    assert result.notes


def test_without_points_safe_sides_are_taken_and_named(still):
    for tracks in (replace(still.metadata[TRACKS], point_ids=np.zeros(0, np.int64)), None):
        result = survey(with_points(still, np.zeros((0, 3)), tracks=tracks))
        assert result.decisions() == OFF
        assert {finding.confidence for finding in result.findings} == {"none"}
        assert result.notes


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("behind", "Points and cameras do not go together"),
        ("turned", "Photos and points do not go together"),
        ("black", "A mask leaves nothing"),
        ("right", ""),
    ],
)
def test_captures_that_cannot_be_right_are_said(still, tmp_path, change, said):
    capture = copied(still, tmp_path)
    if change == "behind":
        capture = with_points(capture, points_of(capture) + np.array([0.0, 0.0, 1e4]))
    if change == "turned":
        for path in capture.image_filenames:
            write_image(path, np.ascontiguousarray(read_image(path)[::-1, ::-1]))
    if change == "black":
        write_image(tmp_path / "mask.png", np.zeros((72, 96, 1), np.uint8))
        capture = replace(capture, mask_filenames=[tmp_path / "mask.png"] * 10)
    result = survey(capture)
    assert said in " ".join(result.notes)
    assert bool(said) == bool(result.notes) == bool(result.mismatch) == bool(mismatch_of(capture))
    assert not said or Path(capture.image_filenames[0]).name in result.mismatch


def test_a_few_wrong_photos_are_no_reason_to_refuse_a_capture(still, tmp_path):
    capture = copied(still, tmp_path)
    for path in capture.image_filenames[:3]:
        write_image(path, np.ascontiguousarray(read_image(path)[::-1, ::-1]))
    result = survey(capture)
    assert "3 of 10 photos" in " ".join(result.notes)
    assert not result.mismatch


def test_two_photos_and_one_call_for_nothing(still):
    for which in ([0, 1], [4]):
        result = survey(some(still, which))
        assert result.decisions() == OFF


@pytest.mark.slow
@pytest.mark.parametrize("level", [0, 255])
def test_a_black_or_white_photo_changes_no_decision(still, tmp_path, level):
    capture = copied(still, tmp_path)
    write_image(capture.image_filenames[3], np.full((72, 96, 3), level, np.uint8))
    assert survey(capture).decisions() == OFF


@pytest.mark.slow
def test_what_is_cut_out_of_all_photos_is_no_sky(still, tmp_path: Path):
    capture = copied(still, tmp_path)
    for path in capture.image_filenames:
        photo = read_image(path)
        alpha = np.full((*photo.shape[:2], 1), 255, np.uint8)
        alpha[: len(photo) // 3] = 0
        write_image(path, np.concatenate([photo[..., :3], alpha], axis=2))
    assert survey(capture).background.decision == "off"


def test_no_photo_is_an_error_and_one_that_cannot_be_read_is_named(still, tmp_path):
    with pytest.raises(CaptureError):
        survey(some(still, []))
    capture = copied(still, tmp_path)
    Path(capture.image_filenames[2]).write_bytes(b"no picture")
    with pytest.raises(CaptureError, match=capture.image_filenames[2].name):
        survey(capture)


def test_what_a_file_is_like_does_not_change_what_is_seen(still, tmp_path: Path):
    """16 bits, grey levels in four channels, and pixels that lie on their side by EXIF."""
    capture = copied(still, tmp_path)
    for number, path in enumerate(capture.image_filenames):
        photo = read_image(path)
        if number % 3 == 0:
            cv2.imwrite(str(path), photo[..., ::-1].astype(np.uint16) * 257)
        elif number % 3 == 1:
            write_image(path, np.dstack([photo, np.full(photo.shape[:2], 255, np.uint8)]))
        else:
            tags = PIL.Image.Exif()
            tags[0x0112] = 6  # orientation
            PIL.Image.fromarray(np.rot90(photo)).save(path, exif=tags)
    assert survey(capture).to_json() == survey(still).to_json()


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_points_without_a_place_are_passed_over(still):
    """As broken reconstructions have them: not a number, and as far as numbers go."""
    for broken in (np.nan, np.inf, 1e30):
        xyz = points_of(still).copy()
        xyz[::50] = broken
        assert survey(with_points(still, xyz)).decisions() == OFF
