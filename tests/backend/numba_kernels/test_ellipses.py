from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.backend.numba_kernels.binning import Grid
from desplat_ns.backend.numba_kernels.ellipses import columns, ellipse, tile_rows

CUTOFF = 1 / 255


def record(mean, conic, opacity):
    return np.array([*mean, *conic, opacity, 0, 0, 0, 0], np.float32)


def test_a_circle_reaches_as_far_as_worked_out_by_hand():
    # opacity e^2 / 255: s = 2, so sigma = r^2 / 2 <= 2 inside radius 2.
    e = ellipse(record((20.0, 24.5), (1, 0, 1), math.exp(2) * CUTOFF), 0, CUTOFF)
    assert e.extent_x == pytest.approx(2, rel=1e-4)
    assert e.extent_y == pytest.approx(2, rel=1e-4)
    # Rows of tiles: y from 22.5 to 26.5, all in the second. Columns: centres 18.5 ... 21.5.
    grid = Grid(64, 64, 4, 4)
    assert tile_rows(e, grid) == (1, 2)
    assert columns(e, 1, grid) == (18, 22)
    assert columns(e, 0, grid)[0] >= columns(e, 0, grid)[1]


def test_a_degenerate_conic_reaches_everywhere():
    e = ellipse(record((5.0, 5.0), (1, 1, 1), 0.5), 0, CUTOFF)
    grid = Grid(50, 40, 4, 3)
    assert tile_rows(e, grid) == (0, 3)
    assert columns(e, 2, grid) == (0, 50)


@st.composite
def gaussians(draw):
    """Mean, conic and opacity; standard deviations from half a pixel to 30 pixels."""
    log_sigma = st.floats(math.log(0.5), math.log(30))
    a, b = math.exp(draw(log_sigma)), math.exp(draw(log_sigma))
    angle = draw(st.floats(0, math.pi))
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    inverse = turn @ np.diag([a**-2, b**-2]) @ turn.T
    mean = (draw(st.floats(-20, 70)), draw(st.floats(-20, 60)))
    return mean, (inverse[0, 0], inverse[0, 1], inverse[1, 1]), draw(st.floats(0.005, 1))


@given(gaussian=gaussians())
def test_the_columns_of_a_row_of_tiles_are_exact(gaussian):
    values = record(*gaussian)
    mean, conic, opacity = values[:2].astype(float), values[2:5].astype(float), float(values[5])
    grid = Grid(50, 40, 4, 3)
    e = ellipse(values, 0, CUTOFF)
    x = np.arange(50) + 0.5 - mean[0]
    # Along y, sigma is least at y = -b x / c, as far as the row of tiles allows.
    for ty in range(3):
        low, high = 16 * ty + 0.5 - mean[1], min(16 * ty + 16, 40) - 0.5 - mean[1]
        y = np.clip(-conic[1] * x / conic[2], low, high)
        sigma = 0.5 * (conic[0] * x**2 + conic[2] * y**2) + conic[1] * x * y
        alpha = opacity * np.exp(-sigma)
        start, stop = columns(e, ty, grid)
        inside = np.zeros(50, bool)
        inside[start:stop] = True
        # SLACK is 2e-5: alphas this close to the cutoff may be in or out.
        assert inside[alpha > CUTOFF].all()
        assert not inside[alpha < CUTOFF * (1 - 3e-5)].any()
