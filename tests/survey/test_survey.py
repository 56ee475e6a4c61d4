"""Decisions on tiny scenes whose truth is known."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.data.images import read_image
from desplat_ns.survey.appearance import LOCAL_SHARE, appearance_finding, local_steps
from desplat_ns.survey.findings import CLEAR, confidence_of
from desplat_ns.survey.observations import observe
from desplat_ns.survey.photo_light import fit_light, from_middle
from desplat_ns.survey.survey import survey
from lab.pictures import write_image
from lab.synthetic import DaylightSpec, SceneSpec, make_scene
from tests.helpers.surveyed import copied

OFF = {"appearance": "off", "background": "off"}


@pytest.mark.parametrize("cluttered", [False, True])
def test_a_still_scene_in_one_light_needs_nothing_whoever_passes_by(make_capture, cluttered):
    assert survey(make_capture(cluttered)).decisions() == OFF


@pytest.mark.slow
def test_exposure_and_white_balance_of_each_photo_are_a_matter_of_the_camera(make_capture):
    result = survey(make_capture(daylight=DaylightSpec(sky=False)))
    assert result.decisions() == {**OFF, "appearance": "camera"}


@pytest.mark.slow
def test_a_sun_that_moves_is_a_matter_of_places(make_capture):
    result = survey(make_capture(daylight=DaylightSpec(strength=0.0, sky=False, sun=80.0)))
    assert result.appearance.decision == "affine"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "daylight", "decision"),
    [("room", None, "off"), ("grove", DaylightSpec(strength=0.8, sky=False), "camera")],
)
def test_gloss_and_fine_detail_are_no_light(make_capture, place, daylight, decision):
    options = {"num_views": 18, "arc_degrees": 324.0, "wall_height": 5.0}
    result = survey(make_capture(place=place, daylight=daylight, **options)).appearance
    assert result.decision == decision
    assert result.figures["local"] < LOCAL_SHARE


def test_what_was_pasted_over_photos_after_their_reconstruction_is_no_light(make_capture):
    pasted = replace(make_capture(), image_filenames=make_capture(cluttered=True).image_filenames)
    result, observations = survey(pasted), observe(pasted)
    light = fit_light(observations)
    steps = local_steps(observations, light, np.ones_like(observations.is_shown))
    as_light = appearance_finding(observations, light, steps)
    assert as_light.figures["local"] > 1.5 * result.appearance.figures["local"]
    assert result.appearance.decision == "off"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("daylight", "decision"),
    [
        (DaylightSpec(strength=0.0, sky=False, plain_sky=(0.5, 0.6, 0.8)), "constant"),
        (None, "sh"),
        (DaylightSpec(strength=0.0), "image"),
    ],
)
def test_skies_are_told_apart(make_capture, daylight, decision):
    result = survey(make_capture(daylight=daylight, wall_height=2.0))
    assert result.decisions() == {**OFF, "background": decision}


@pytest.mark.slow
def test_the_walls_behind_a_table_that_one_looks_down_on_are_no_sky(make_capture):
    result = survey(make_capture(cluttered=True, place="table", arc_degrees=150.0))
    assert result.decisions() == OFF


@pytest.fixture(scope="module")
def sky_masks(small_spec: SceneSpec) -> list[np.ndarray]:
    """Where each photo of the small scene with low walls shows the sky."""
    low = replace(small_spec, wall_height=2.0, num_points=9)
    return [np.isinf(frame.depth) for frame in make_scene(low).clean]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("daylight", "decision"),
    [(DaylightSpec(strength=0.0, sky=False, sun=80.0), "sh"), (None, "image")],
)
def test_a_sky_that_is_only_brighter_is_another_one_unless_light_changes_place_by_place(
    make_capture,
    sky_masks: list[np.ndarray],
    tmp_path: Path,
    daylight: DaylightSpec | None,
    decision: str,
):
    """How bright it is says nothing where the light of a photo as a whole is not known."""
    capture = copied(make_capture(daylight=daylight, wall_height=2.0), tmp_path)
    for path, is_sky in [*zip(capture.image_filenames, sky_masks, strict=True)][::2]:
        factor = np.where(is_sky, 0.8, 1.0)[..., None]
        write_image(path, (factor * read_image(path)).astype(np.uint8))
    assert survey(capture).background.decision == decision


def test_json_is_plain_the_same_each_time_and_says_what_the_console_says(still):
    result = survey(still)
    assert result.to_json() == survey(still).to_json()
    plain = json.loads(result.to_json())
    assert {e: plain[e]["decision"] for e in result.decisions()} == result.decisions()
    assert len(result.summary()) == 2
    assert plain["appearance"]["figures"].keys() == {"change", "explained", "local"}


def test_confidence_is_that_of_the_figure_nearest_to_its_threshold():
    def sure(*values: float) -> str:
        return confidence_of(*((value, 1.0) for value in values))

    assert sure(CLEAR * 1.01, 0.0) == sure(1 / (CLEAR * 1.01)) == "clear"
    assert (sure(1.1, 100.0), sure(math.nan)) == ("close", "none")


def darkened(
    capture: DataparserOutputs, folder: Path, every: int, power: int, strength: float
) -> DataparserOutputs:
    """A copy in which some photos are darker towards their corners, by exp(-strength rho^power)."""
    capture = copied(capture, folder)
    for path in capture.image_filenames[::every]:
        photo = read_image(path)
        height, width = photo.shape[:2]
        places = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1) + 0.5
        rho2 = from_middle((width, height), places)[..., None]
        darker = photo * np.exp(-strength * rho2 ** (power / 2))
        write_image(path, darker.round().astype(np.uint8))
    return capture


def test_a_lens_that_darkens_only_the_corners_of_all_photos_is_found(still, tmp_path):
    capture = darkened(still, tmp_path, 1, 4, 0.8)
    assert fit_light(observe(capture)).lens == pytest.approx(-0.8, abs=0.25)
    assert survey(capture).appearance.figures["local"] < 0.02


def test_a_lens_that_darkens_corners_is_no_light_that_changes_place_by_place(still, tmp_path):
    """Every other photo, as if with the aperture wide open: corners have half of their value."""
    capture = darkened(still, tmp_path, 2, 2, np.log(2))
    assert survey(capture).appearance.decision != "affine"
    assert fit_light(observe(capture)).numbers[:, 4].std() > 0.05
