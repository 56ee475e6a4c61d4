"""What pages share: escaping, pictures that fit into a number of bytes."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from desplat_ns.core.errors import ConfigError
from desplat_ns.core.pages import LARGEST_SIDE, Picture, fitted_into, to_rgb8
from lab.synthetic.textures import f32
from tests.helpers.report import flat, noise


def opened(source: str) -> Image.Image:
    start = "data:image/webp;base64,"
    assert source.startswith(start)
    return Image.open(io.BytesIO(base64.b64decode(source.removeprefix(start))))


@pytest.mark.slow
def test_a_smaller_budget_gives_smaller_pictures_and_holds():
    pictures = [Picture(noise(seed, 350, 250)) for seed in range(4)]
    sizes = []
    for budget in (300_000, 30_000):
        sources = fitted_into(pictures, budget)
        assert sum(map(len, sources)) <= budget and len(sources) == 4
        sizes.append(opened(sources[0]).size)
    assert sizes == sorted(sizes, reverse=True)
    assert fitted_into([], 10) == []


def test_pictures_in_order_and_those_shown_smaller_have_fewer_pixels():
    pictures = (flat((250, 0, 0), 2000, 1000), 1.0), (flat((0, 250, 0), 1000, 2000), 0.5)
    first, second = map(opened, fitted_into([Picture(*each) for each in pictures], 10**7))
    assert first.size == (LARGEST_SIDE, LARGEST_SIDE // 2)
    assert second.size == (LARGEST_SIDE // 4, LARGEST_SIDE // 2)
    assert np.asarray(first)[5, 5, 0] > 200 > np.asarray(second)[5, 5, 0]


def test_too_many_pictures_are_refused_with_what_to_type():
    with pytest.raises(ConfigError, match="--training-photos"):
        fitted_into([Picture(noise(seed)) for seed in range(5)], 300)


def test_floats_and_booleans_become_8_bit_colours():
    assert to_rgb8(f32([[[0.2, 1.5, -1.0]]])).tolist() == [[[51, 255, 0]]]
    assert to_rgb8(f32([[[0.5]]])).tolist() == [[[128] * 3]]
    assert to_rgb8(np.array([[[True], [False]]])).tolist() == [[[255] * 3, [0] * 3]]
    picture = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    np.testing.assert_array_equal(to_rgb8(picture), picture)
