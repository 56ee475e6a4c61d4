from __future__ import annotations

import numpy as np
import pytest

from desplat_ns.evaluation.pictures import over_checkerboard, to_rgb8
from lab.synthetic.textures import f32


def test_floats_and_booleans_become_8_bit_colours():
    assert to_rgb8(f32([[[0.2, 1.5, -1.0]]])).tolist() == [[[51, 255, 0]]]
    assert to_rgb8(f32([[[0.5]]])).tolist() == [[[128] * 3]]
    assert to_rgb8(np.array([[[True], [False]]])).tolist() == [[[255] * 3, [0] * 3]]
    picture = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    np.testing.assert_array_equal(to_rgb8(picture), picture)


def test_a_layer_over_the_checkerboard_hides_it_by_its_alpha():
    rgb, alpha = np.zeros((16, 16, 3), np.float32), np.zeros((16, 16, 1), np.float32)
    rgb[:8], alpha[:8] = 0.25, 0.5
    drawn = over_checkerboard(rgb, alpha)
    assert drawn[0, 0, 0] == pytest.approx(0.25 + 0.5 * 0.92)
    assert drawn[15, 0, 0] == pytest.approx(0.8)
    assert drawn[15, 15, 0] == pytest.approx(0.92)
