from __future__ import annotations

import numpy as np
import torch

from desplat_ns.backend.spherical_harmonics import sh_basis
from lab.synthetic.arrays import f32
from lab.synthetic.daylight import DaylightSpec, draw_daylights
from lab.synthetic.light import apply_light
from lab.synthetic.sky import Sky

SKY = Sky((0.5, 0.6, 0.7), (0.1, 0.2, 0.8), (0.2, 0.1, 0.04), azimuth=np.pi / 2)
DAYLIGHTS = draw_daylights(DaylightSpec(), 60, np.random.default_rng(0))


def upper_hemisphere() -> np.ndarray:
    """Unit directions [3, N] up to 70 degrees above the horizon."""
    azimuth, height = np.meshgrid(np.linspace(0, 2 * np.pi, 48), np.radians(np.linspace(0, 70, 30)))
    azimuth, height = azimuth.ravel(), height.ravel()
    flat = np.cos(height)
    return f32([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(height)])


def residual(colors: np.ndarray, directions: np.ndarray, degree: int) -> float:
    """Largest difference to the spherical harmonics of `degree` that fit the colours best."""
    basis = sh_basis(degree, torch.from_numpy(directions.T.astype(np.float64))).numpy()
    coefficients, *_ = np.linalg.lstsq(basis, colors.T.astype(np.float64), rcond=None)
    return float(np.abs(basis @ coefficients - colors.T).max())


def test_colours_worked_out_by_hand():
    directions = f32([[0, 0, 0, 1], [1, -1, 0, 0], [0, 0, 1, 0]])
    expected = [
        [0.7, 0.7, 0.74],  # the horizon and all of the glow
        [0.5, 0.6, 0.7],  # the horizon
        [0.15, 0.225, 0.81],  # the zenith and a quarter of the glow
        [0.55, 0.625, 0.71],  # the horizon and a quarter of the glow
    ]
    np.testing.assert_allclose(SKY.toward(directions).T, expected, atol=1e-6)


def test_the_length_of_a_direction_does_not_matter():
    directions = upper_hemisphere()
    np.testing.assert_allclose(
        SKY.toward(directions), SKY.toward(3 * directions), rtol=1e-5, atol=1e-6
    )


def test_below_the_horizon_the_sky_has_no_colour_of_its_own():
    sky = Sky(SKY.horizon, SKY.zenith, (0.0, 0.0, 0.0))
    below = sky.toward(f32([[0.6], [0.0], [-0.8]]))
    np.testing.assert_allclose(below[:, 0], sky.horizon, rtol=1e-6)


def test_spherical_harmonics_of_degree_2_are_the_sky():
    directions = upper_hemisphere()
    assert residual(SKY.toward(directions), directions, 2) < 1e-5
    assert residual(SKY.toward(directions), directions, 1) > 1e-2


def test_spherical_harmonics_of_degree_4_are_any_lit_sky_to_less_than_a_level():
    directions = upper_hemisphere()
    for daylight in DAYLIGHTS:
        assert daylight.sky is not None
        colors = daylight.sky.toward(directions).T[None]
        lit = apply_light(colors, daylight.light)
        factor = daylight.light.gain * np.array(daylight.light.tint)
        unclipped = factor * colors**daylight.light.gamma
        np.testing.assert_allclose(np.minimum(unclipped, 1), lit, rtol=1e-5)
        assert residual(unclipped[0].T, directions, 4) < 1 / 255


def test_every_sky_lies_in_the_range_of_colours():
    for daylight in DAYLIGHTS:
        assert daylight.sky is not None
        colors = daylight.sky.toward(upper_hemisphere())
        assert colors.min() >= 0.1
        assert colors.max() <= 1
