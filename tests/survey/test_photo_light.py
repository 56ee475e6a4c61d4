"""The fitted light of photos is the one that they were taken in."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from desplat_ns.photo_tourism.camera_response import camera_response
from desplat_ns.survey.observations import Observations, View, observe
from desplat_ns.survey.photo_light import fit_light
from lab.synthetic import DaylightSpec
from lab.synthetic.daylight import draw_daylights


@pytest.mark.slow
def test_fitted_lights_are_those_that_the_photos_were_taken_in(make_capture, small_spec):
    daylight = DaylightSpec(sky=False)
    light = fit_light(observe(make_capture(daylight=daylight)))
    drawn = draw_daylights(daylight, small_spec.num_views, small_spec.rng(8))  # as by `make_scene`
    true = [daylight.light for daylight in drawn]
    gammas = np.array([lighting.gamma for lighting in true])
    gains = np.log([lighting.gain * np.array(lighting.tint) for lighting in true])
    # What all share belongs to the scene: gammas over their mean, gains about a line in gamma.
    fitted = np.exp(light.numbers[:, 3])
    np.testing.assert_allclose(fitted, gammas / np.exp(np.log(gammas).mean()), atol=0.05)
    shown = gains + gammas[:, None] * np.log(0.5)
    fitted = light.numbers[:, :3] + fitted[:, None] * np.log(0.5)
    spread = (shown - shown.mean(axis=0)) - (fitted - fitted.mean(axis=0))
    assert np.abs(spread).max() < 0.1
    assert np.abs(shown - shown.mean(axis=0)).max() > 0.25


def chain(gains: np.ndarray) -> Observations:
    """A walk: every photo shares 40 points with the next one and none with any other."""
    rng = np.random.default_rng(0)
    count, shared = len(gains), 40
    number = shared * (count - 1)
    tracked = np.zeros((count, number), bool)
    for row in range(count - 1):
        tracked[row : row + 2, shared * row : shared * (row + 1)] = True
    colors = rng.uniform(0.2, 0.6, (number, 3)) * np.exp(gains)[:, None, None]
    K = np.array([[90.0, 0.0, 48.0], [0.0, 90.0, 36.0], [0.0, 0.0, 1.0]])
    view = View(np.eye(3), np.zeros(3), K, (96, 72), np.zeros(6), False)
    return Observations(
        views=[view] * count,
        photos=[],
        allowed=[],
        xyz=np.zeros((number, 3)),
        places=np.broadcast_to(rng.uniform([0, 0], [96, 72], (number, 2)), (count, number, 2)),
        is_shown=tracked,
        is_tracked=tracked,
        colors=colors,
        structures=np.zeros((count, number, 25)),
        has_tracks=True,
        all_xyz=np.zeros((0, 3)),
        num_in_view=np.zeros(count, int),
        names=[],
    )


def test_a_light_that_creeps_along_a_walk_is_found_to_its_end():
    """Photo by photo the ends would have come a part of the way only: see `_joint_gains`."""
    gains = np.linspace(-0.3, 0.3, 30)
    light = fit_light(chain(gains))
    fitted = light.numbers[:, :3].mean(axis=1) + np.expm1(light.numbers[:, 3]) * np.log(0.4)
    assert fitted[-1] - fitted[0] == pytest.approx(0.6, abs=0.1)


def test_a_light_taken_back_gives_the_colour_under_the_mean_light(still):
    light = replace(fit_light(observe(still)), lens=-0.3)
    light.numbers[0] = [0.1, 0.0, -0.1, 0.3, -0.2]
    true, rho2 = np.array([[0.5, 0.25, 0.7]]), np.array([0.4])
    shown = camera_response(*map(torch.from_numpy, (true, light.numbers[0], rho2[:, None])))
    photo = shown.numpy() * np.exp(-0.3 * rho2**2)
    np.testing.assert_allclose(light.neutral(0, photo, rho2), true, rtol=1e-12)
