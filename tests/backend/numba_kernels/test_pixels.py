from __future__ import annotations

import math

import numpy as np
import pytest

from desplat_ns.backend.numba_kernels import pixels as numba_pixels
from desplat_ns.backend.numba_kernels.ellipses import FEATURES, OPACITY, PAIR
from desplat_ns.backend.numba_kernels.pixels import (
    AREA,
    F0,
    F1,
    GEOMETRY,
    LAST,
    NO_SUMS,
    PLANE,
    PLANES_BEFORE_FEATURES,
    SUM,
    Limits,
    T,
    U,
    X,
    Y,
    backward,
    backward_more,
    blend,
    blend_more,
    gather_more,
    write_row,
)

LIMITS = Limits(np.float32(0.999), np.float32(1 / 255), np.float32(1e-4))
ROUNDING = 1e-6
"""A dozen operations in float32."""


def open_planes(features: int = 4) -> np.ndarray:
    """Scratch planes of a tile whose pixels all lie at (0, 0)."""
    s = np.zeros(PLANE * (PLANES_BEFORE_FEATURES + features), np.float32)
    s[int(T) : int(T) + AREA] = 1
    s[int(LAST) : int(LAST) + AREA] = -1
    return s


def record(opacity, features, mean=(0.0, 0.0), conic=(1.0, 0.0, 1.0)):
    return np.array([*mean, *conic, opacity, *features], np.float32)


def at(s, plane, pixel=0):
    return float(s[int(plane) + pixel])


def test_exp2_is_within_two_units_in_the_last_place():
    powers = np.linspace(-39.9, 0, 4001, dtype=np.float32)
    got = np.array([numba_pixels._exp2(power) for power in powers], float)
    assert got == pytest.approx(2.0 ** powers.astype(float), rel=2**-22)


def test_exp2_stays_small_and_normal_far_out():
    for power in (-41, -126, -127, -1e4, -1e9, -1e38):
        value = float(numba_pixels._exp2(np.float32(power)))
        assert 0 < value < 2**-39
        assert value >= np.finfo(np.float32).tiny


def test_two_gaussians_blend_as_worked_out_by_hand():
    s = open_planes()
    blend(s, record(0.5, [1, 0, 0, 2]), 0, np.float32(0), 0, PAIR, LIMITS)
    blend(s, record(0.5, [0, 1, 0, 4]), 0, np.float32(1), 0, PAIR, LIMITS)
    # Weights 0.5 and 0.5 * 0.5.
    assert [at(s, int(F0) + k * PLANE) for k in range(4)] == pytest.approx([0.5, 0.25, 0, 2])
    assert at(s, T) == pytest.approx(0.25)
    assert at(s, LAST) == 1
    assert at(s, T, pixel=PAIR) == 1  # beyond `stop`


def test_alpha_falls_off_with_the_conic():
    s = open_planes()
    s[int(X)], s[int(Y)] = 3.0, 5.0
    values = record(0.8, [1, 0, 0, 0], mean=(2.0, 7.0), conic=(0.5, 0.1, 0.25))
    blend(s, values, 0, np.float32(0), 0, PAIR, LIMITS)
    # d = (-1, 2): sigma = (0.5 + 2 * 0.1 * -2 + 0.25 * 4) / 2 = 0.55
    assert at(s, F0) == pytest.approx(0.8 * math.exp(-0.55), rel=ROUNDING)


def test_a_pixel_is_finished_before_its_transmittance_falls_to_1e_4():
    s = open_planes()
    for place, opacity in enumerate((0.99, 0.98, 0.6, 0.2)):
        blend(s, record(opacity, [1, 0, 0, 0]), 0, np.float32(place), 0, PAIR, LIMITS)
    # 0.01, 0.0002; then 0.00008 would be too little, and what follows is not looked at.
    assert at(s, T) == pytest.approx(-0.0002, rel=1e-4)
    assert at(s, LAST) == 1
    assert at(s, F0) == pytest.approx(1 - 0.0002, rel=ROUNDING)


def test_alphas_below_the_cutoff_leave_no_trace():
    s = open_planes()
    before = s.copy()
    blend(s, record(0.99 / 255, [1, 1, 1, 1]), 0, np.float32(0), 0, PAIR, LIMITS)
    assert (s == before).all()


def draw(values, features, v, u):
    """Blend a list of records over one pixel, then pull; returns value and rows of gradients."""
    s, stride = open_planes(features), FEATURES + features
    s[int(X)], s[int(Y)] = 0.25, -0.5
    s[int(T) + 1 : int(T) + PAIR] = -1  # one pixel only
    for place, value in enumerate(values):
        blend(s, value, 0, np.float32(place), 0, PAIR, LIMITS)
        blend_more(s, value, 0, stride, 0, PAIR)
    planes = [at(s, int(F0) + k * PLANE) for k in range(features)]
    total = float(np.dot(planes, v)) + u * (1 - abs(at(s, T)))
    s[int(T) : int(T) + PAIR] = np.abs(s[int(T) : int(T) + PAIR])
    s[int(SUM) : int(SUM) + PAIR] = 0
    s[int(U)] = u
    for k in range(features):
        s[int(F0) + k * PLANE] = v[k]
    rows = np.zeros((len(values), GEOMETRY + features), np.float32)
    for place in reversed(range(len(values))):
        flat = rows[place]
        gather_more(s, values[place], 0, stride, 0, PAIR)
        sums = backward(s, values[place], 0, np.float32(place), 0, PAIR, LIMITS, NO_SUMS)
        write_row(sums, values[place][OPACITY], flat, 0)
        backward_more(s, stride, 0, PAIR, flat, 0)
    return total, rows


@pytest.mark.parametrize("features", [4, 8])
def test_gradients_agree_with_finite_differences(features):
    rng = np.random.default_rng(features)
    values = [
        record(o, rng.random(features), mean=rng.normal(0, 0.5, 2), conic=(0.9, 0.2, 0.6))
        for o in (0.4, 0.7, 0.5)
    ]
    v, u = rng.normal(size=features).astype(np.float32), np.float32(0.7)
    _, rows = draw(values, features, v, u)
    columns = [0, 1, 4, 5, 6, 7, *range(GEOMETRY, GEOMETRY + features)]  # of the row, by record
    # Rounding of float32 over the step, and its square: 2^-23 / 2^-8 + 2^-16 < 1e-4.
    step = np.float32(2**-8)
    for i in range(3):
        for place, column in enumerate(columns):
            ends = []
            for sign in (1, -1):
                moved = [value.copy() for value in values]
                moved[i][place] += sign * step
                ends.append(draw(moved, features, v, u)[0])
            slope = (ends[0] - ends[1]) / (2 * float(step))
            # dL/dconic b counts b once: it stands twice in the matrix.
            assert rows[i][column] == pytest.approx(slope, abs=1e-3 * np.abs(rows).max())
    assert np.abs(rows[:, 2:4]) == pytest.approx(np.abs(rows[:, :2]))


def test_no_gradient_passes_the_clamp():
    clamped = record(1.0, [1, 0, 0, 0], mean=(0.25, -0.5))
    _, rows = draw([clamped, record(0.5, [0, 1, 0, 0])], 4, np.ones(4, np.float32), np.float32(0))
    assert (rows[0][:GEOMETRY] == 0).all()
    assert rows[0][GEOMETRY] == pytest.approx(0.999)


def test_planes_are_not_four_kilobytes_apart():
    distances = {4 * PLANE * k % 4096 for k in range(1, 12)}
    assert all(32 <= d <= 4096 - 32 for d in distances)
    assert int(F1) - int(F0) == PLANE
