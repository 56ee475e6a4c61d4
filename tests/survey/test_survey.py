"""Decisions on tiny scenes whose truth is known, and what cannot be looked at."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest
import torch

from desplat_ns.data.images import read_image, write_image
from desplat_ns.errors import CaptureError
from desplat_ns.survey import observations
from desplat_ns.survey.findings import Finding, Survey
from desplat_ns.survey.light import appearance_finding, local_steps
from desplat_ns.survey.observations import Capture
from desplat_ns.survey.photo_light import from_middle
from desplat_ns.survey.picture import evidence_picture
from desplat_ns.survey.survey import survey as survey_with_evidence
from lab.synthetic import DaylightSpec, SceneSpec, make_scene

ORIENTATION = 0x0112
"""EXIF's tag."""
OFF = {"distractors": False, "appearance": "off", "background": "off"}
SAFE = {"distractors": True, "appearance": "off", "background": "off"}


def survey(capture: Capture) -> Survey:
    """The findings alone."""
    return survey_with_evidence(capture)[0]


def copied(capture: Capture, folder: Path) -> Capture:
    """The same capture with photos of its own, to be damaged."""
    photos = [Path(shutil.copy(path, folder / path.name)) for path in capture.photos]
    return replace(capture, photos=photos)


def some(capture: Capture, which: list[int]) -> Capture:
    """Some of the photos."""
    tracks = capture.tracks
    assert tracks is not None
    return replace(
        capture,
        cameras=capture.cameras[torch.tensor(which, dtype=torch.long)],
        photos=[capture.photos[i] for i in which],
        tracks=replace(tracks, image_ids=tuple(tracks.image_ids[i] for i in which)),
    )


def test_a_still_scene_in_one_light_needs_nothing(still: Capture):
    assert survey(still).decisions() == OFF


def test_passers_by_are_seen(make_capture: Callable[..., Capture]):
    found = survey(make_capture(cluttered=True))
    assert found.decisions() == {**OFF, "distractors": True}
    assert found.distractors.confidence == "clear"


def test_exposure_and_white_balance_of_each_photo_are_a_matter_of_the_camera(
    make_capture: Callable[..., Capture],
):
    found = survey(make_capture(daylight=DaylightSpec(sky=False)))
    assert found.decisions() == {**OFF, "appearance": "camera"}


@pytest.mark.parametrize(("strength", "degrees"), [(0.5, 120.0), (0.0, 80.0)])
def test_a_sun_that_moves_is_a_matter_of_places(
    make_capture: Callable[..., Capture], strength: float, degrees: float
):
    found = survey(make_capture(daylight=DaylightSpec(strength=strength, sky=False, sun=degrees)))
    assert found.appearance.decision == "affine"


@pytest.mark.parametrize("place", ["room", "grove"])
def test_gloss_and_fine_detail_are_no_light(make_capture: Callable[..., Capture], place: str):
    found = survey(make_capture(place=place, arc_degrees=324.0, wall_height=5.0)).appearance
    figures = {figure.name: figure for figure in found.figures}
    assert figures["local"].is_above
    assert found.decision == "off"
    assert "gloss" in found.reason


def test_what_was_pasted_over_photos_after_their_reconstruction_is_no_light(
    make_capture: Callable[..., Capture],
):
    pasted = replace(make_capture(), photos=make_capture(cluttered=True).photos)
    found, evidence = survey_with_evidence(pasted)
    nothing = np.zeros_like(evidence.seen.is_shown)
    as_light = appearance_finding(evidence.seen, evidence.light, nothing)
    assert share_of_places(as_light) > 1.5 * share_of_places(found.appearance)
    assert found.appearance.decision == "off"


def share_of_places(found: Finding) -> float:
    """What the light leaves off, of a finding about appearance."""
    (local,) = (figure.value for figure in found.figures if figure.name == "local")
    return local


def test_what_is_in_the_way_is_no_light(make_capture: Callable[..., Capture]):
    _, evidence = survey_with_evidence(make_capture(cluttered=True))
    seen, light = evidence.seen, evidence.light
    in_the_way = np.zeros_like(seen.is_shown)
    in_the_way[2] = True
    every = local_steps(seen, light, np.zeros_like(in_the_way))
    some_steps = local_steps(seen, light, in_the_way)
    of_the_photo = light.photo == 2
    assert np.isfinite(every[of_the_photo]).any()
    assert np.isnan(some_steps[of_the_photo]).all()
    np.testing.assert_array_equal(some_steps[~of_the_photo], every[~of_the_photo])


@pytest.mark.parametrize(
    ("daylight", "decision"),
    [
        (DaylightSpec(strength=0.0, sky=False, plain_sky=(0.5, 0.6, 0.8)), "constant"),
        (None, "sh"),
        (DaylightSpec(strength=0.0), "image"),
    ],
)
def test_skies_are_told_apart(make_capture: Callable[..., Capture], daylight, decision):
    found = survey(make_capture(daylight=daylight, wall_height=2.0))
    assert found.decisions() == {**OFF, "background": decision}


@pytest.fixture(scope="module")
def sky_masks(small_spec: SceneSpec) -> list[np.ndarray]:
    """Where each photo of the small scene with low walls shows the sky."""
    low = replace(small_spec, wall_height=2.0, supersample=1, num_points=9)
    return [np.isinf(frame.depth) for frame in make_scene(low).clean]


@pytest.mark.parametrize(
    ("daylight", "decision"),
    [(DaylightSpec(strength=0.0, sky=False, sun=80.0), "sh"), (None, "image")],
)
def test_a_sky_that_is_only_brighter_is_another_one_unless_light_changes_place_by_place(
    make_capture: Callable[..., Capture],
    sky_masks: list[np.ndarray],
    tmp_path: Path,
    daylight: DaylightSpec | None,
    decision: str,
):
    """How bright it is says nothing where the light of a photo as a whole is not known."""
    capture = copied(make_capture(daylight=daylight, wall_height=2.0), tmp_path)
    for path, is_sky in [*zip(capture.photos, sky_masks, strict=True)][::2]:
        factor = np.where(is_sky, 0.8, 1.0)[..., None]
        write_image(path, (factor * read_image(path)).astype(np.uint8))
    assert survey(capture).background.decision == decision


def test_the_same_capture_gives_the_same_findings(still: Capture):
    assert survey(still).to_json() == survey(still).to_json()


def test_json_is_plain_and_says_what_the_console_says(still: Capture):
    found = survey(still)
    plain = json.loads(found.to_json())
    assert {e: plain[e]["decision"] for e in found.decisions()} == found.decisions()
    lines = "\n".join(found.summary())
    assert all(f.name in lines for finding in found.findings for f in finding.figures)


def test_without_tracks_patches_stand_for_them(make_capture: Callable[..., Capture]):
    for cluttered in (False, True):
        capture = replace(make_capture(cluttered=cluttered), tracks=None)
        found = survey(capture)
        assert found.distractors.decision is cluttered
        assert any("tracks" in line for line in found.notes)


def test_without_points_safe_sides_are_taken_and_named(still: Capture):
    for tracks in (still.tracks and still.tracks.keep(np.zeros(len(still.xyz), bool)), None):
        found = survey(replace(still, xyz=np.zeros((0, 3)), tracks=tracks))
        assert found.decisions() == SAFE
        assert {finding.confidence for finding in found.findings} == {"none"}
        assert "no points" in found.notes[0]


def test_two_photos_and_one_are_not_enough_to_rule_distractors_out(still: Capture):
    for which in ([0, 1], [4]):
        found = survey(some(still, which))
        assert found.decisions() == SAFE
        assert found.distractors.confidence == "none"


def test_no_photo_is_an_error(still: Capture):
    with pytest.raises(CaptureError, match="no training photo"):
        survey(some(still, []))


def test_photos_that_are_all_alike_call_for_nothing_that_is_seen(still: Capture, tmp_path: Path):
    capture = copied(still, tmp_path)
    for path in capture.photos:
        write_image(path, np.full((72, 96, 3), 128, np.uint8))
    assert survey(capture).appearance.decision == "off"


@pytest.mark.parametrize("level", [0, 255])
def test_a_black_or_white_photo_changes_no_decision_and_is_named(
    still: Capture, tmp_path: Path, level: int
):
    capture = copied(still, tmp_path)
    write_image(capture.photos[3], np.full((72, 96, 3), level, np.uint8))
    found = survey(capture)
    assert found.decisions() == OFF
    for finding in (found.appearance, found.distractors):
        assert any(capture.photos[3].name in line for line in finding.could_not_tell)


def test_one_photo_that_shows_something_else_is_at_fault_itself(still: Capture, tmp_path: Path):
    """As with a wrong pose, or a finger before the lens."""
    capture = copied(still, tmp_path)
    shutil.copy(capture.photos[8], capture.photos[3])
    found = survey(capture).distractors
    figures = {figure.name: figure for figure in found.figures}
    assert figures["photos_covered"].value == pytest.approx(1 / len(capture.photos))
    assert found.decision is False


def test_a_lens_that_darkens_corners_is_no_light_that_changes_place_by_place(
    still: Capture, tmp_path: Path
):
    """Every other photo, as if with the aperture wide open: corners have half of their value."""
    capture = copied(still, tmp_path)
    for path in capture.photos[::2]:
        photo = read_image(path)
        height, width = photo.shape[:2]
        places = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1) + 0.5
        darkened = photo * 0.5 ** from_middle((width, height), places)[..., None]
        write_image(path, darkened.round().astype(np.uint8))
    found = survey(capture).appearance
    assert found.decision != "affine"
    (vignetting,) = (figure.value for figure in found.figures if figure.name == "vignetting")
    assert vignetting > 0.05


def test_a_photo_of_the_sky_alone_does_not_make_a_background(still: Capture, tmp_path: Path):
    capture = copied(still, tmp_path)
    write_image(capture.photos[3], np.full((72, 96, 3), (120, 170, 230), np.uint8))
    assert survey(capture).background.decision == "off"


def test_what_is_cut_out_of_all_photos_is_no_sky(still: Capture, tmp_path: Path):
    capture = copied(still, tmp_path)
    for path in capture.photos:
        photo = read_image(path)
        alpha = np.full((*photo.shape[:2], 1), 255, np.uint8)
        alpha[: len(photo) // 3] = 0
        write_image(path, np.concatenate([photo[..., :3], alpha], axis=2))
    found = survey(capture)
    assert found.background.decision == "off"
    assert found.distractors.decision is False


def test_a_photo_that_cannot_be_read_is_named(still: Capture, tmp_path: Path):
    capture = copied(still, tmp_path)
    Path(capture.photos[2]).write_bytes(b"no picture")
    with pytest.raises(CaptureError, match=capture.photos[2].name):
        survey(capture)


def test_large_captures_are_sampled_evenly_and_say_so(
    still: Capture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(observations, "MOST_PHOTOS", 5)
    found = survey(still)
    assert (found.num_surveyed, found.num_photos) == (5, 10)
    assert any("evenly" in line for line in found.notes)


def test_what_masks_leave_out_is_not_looked_at(
    make_capture: Callable[..., Capture], tmp_path: Path
):
    capture = make_capture(cluttered=True)
    masks = []
    for path in capture.photos:
        truth = read_image(path.parent.parent / "masks" / path.name)[..., 0] > 0
        masks.append(tmp_path / path.name)
        widened = np.pad(truth, 4)
        widened = np.stack(
            [np.roll(widened, shift, axis) for axis in (0, 1) for shift in range(-4, 5)]
        ).any(axis=0)[4:-4, 4:-4]
        write_image(masks[-1], ~widened)
    masked = survey(replace(capture, masks=masks))
    covered = {True: masked, False: survey(capture)}
    values = {key: found.distractors.figures[0].value for key, found in covered.items()}
    assert values[True] < 0.1 * values[False]


def test_the_picture_shows_all_rows(still: Capture):
    picture = evidence_picture(survey_with_evidence(still)[1])
    assert picture.dtype == np.uint8
    assert picture.shape[0] > 4 * 150


def test_what_a_file_is_like_does_not_change_what_is_seen(still: Capture, tmp_path: Path):
    """16 bits, grey levels in four channels, and pixels that lie on their side by EXIF."""
    capture = copied(still, tmp_path)
    for number, path in enumerate(capture.photos):
        photo = read_image(path)
        if number % 3 == 0:
            cv2.imwrite(str(path), photo[..., ::-1].astype(np.uint16) * 257)
        elif number % 3 == 1:
            write_image(path, np.dstack([photo, np.full(photo.shape[:2], 255, np.uint8)]))
        else:
            tags = PIL.Image.Exif()
            tags[ORIENTATION] = 6
            PIL.Image.fromarray(np.rot90(photo)).save(path, exif=tags)
    assert survey(capture).to_json() == survey(still).to_json()


def test_photos_of_two_sizes_are_compared(still: Capture, tmp_path: Path):
    capture = copied(still, tmp_path)
    cameras = copy.deepcopy(capture.cameras)
    for path in capture.photos[::2]:
        write_image(path, cv2.resize(read_image(path), (48, 36), interpolation=cv2.INTER_AREA))
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        values = getattr(cameras, name)
        values[::2] = values[::2] // 2 if name in ("width", "height") else values[::2] / 2
    found = survey(replace(capture, cameras=cameras))
    assert found.decisions() == OFF


@pytest.mark.filterwarnings("error")
def test_points_without_a_place_are_passed_over(still: Capture):
    """As broken reconstructions have them: not a number, and as far as numbers go."""
    for broken in (np.nan, np.inf, 1e30):
        xyz = still.xyz.copy()
        xyz[::50] = broken
        assert survey(replace(still, xyz=xyz)).decisions() == OFF


def test_photos_of_which_none_shows_what_another_does_take_the_safe_side(still: Capture):
    """Each observes points of its own."""
    assert still.tracks is not None
    alone = replace(still.tracks, point_ids=np.arange(len(still.xyz)) + 10**6)
    found = survey(replace(still, tracks=alone))
    assert found.decisions() == SAFE
    assert found.distractors.confidence == "none"
