from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.errors import ConfigError
from lab.synthetic.arrays import f32
from lab.synthetic.light import Light, apply_light

LIGHT = Light(0.8, (1.0, 1.25, 0.5), 2.0)


def test_a_pixel_worked_out_by_hand():
    # 0.8 * (1, 1.25, 0.5) * 0.5^2
    np.testing.assert_allclose(
        apply_light(f32([[[0.5, 0.5, 0.5]]]), LIGHT)[0, 0], [0.2, 0.25, 0.1], rtol=1e-6
    )


def test_the_default_light_changes_nothing():
    rgb = f32(np.random.default_rng(0).random((4, 5, 3)))
    np.testing.assert_allclose(apply_light(rgb, Light()), rgb, rtol=1e-6)


def test_highlights_clip_and_black_stays_black():
    bright = Light(2.0, (1.0, 1.0, 1.0), 0.5)
    lit = apply_light(f32([[[1.0, 0.36, 0.0]]]), bright)
    assert lit.tolist() == [[[1.0, 1.0, 0.0]]]


@given(
    rgb=st.tuples(*[st.floats(0.05, 1.0)] * 3),
    gain=st.floats(0.4, 1.2),
    tint=st.tuples(*[st.floats(0.7, 1.3)] * 3),
    gamma=st.floats(0.6, 1.6),
)
def test_a_known_light_can_be_taken_back_where_nothing_clips(rgb, gain, tint, gamma):
    lit = apply_light(f32([[rgb]]), Light(gain, tint, gamma))[0, 0].astype(np.float64)
    back = (lit / (gain * np.array(tint))) ** (1 / gamma)
    unclipped = lit < 1
    np.testing.assert_allclose(back[unclipped], np.array(rgb)[unclipped], rtol=1e-5)


def test_strength_leads_from_no_change_to_the_light_itself():
    assert LIGHT.scaled(0.0) == Light()
    assert LIGHT.scaled(1.0) == LIGHT
    half = LIGHT.scaled(0.5)
    assert half.gain**2 == pytest.approx(LIGHT.gain)
    assert half.gamma**2 == pytest.approx(LIGHT.gamma)
    np.testing.assert_allclose(np.square(half.tint), LIGHT.tint)


@pytest.mark.parametrize(
    "values", [(0.0, (1.0, 1.0, 1.0), 1.0), (1.0, (1.0, -1.0, 1.0), 1.0), (1.0, (1.0,) * 3, 0.0)]
)
def test_a_light_that_shows_nothing_is_an_error(values):
    with pytest.raises(ConfigError, match="above 0"):
        Light(*values)
