"""Pictures as bytes: the budget holds, nothing is enlarged."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from desplat_ns.errors import ConfigError
from desplat_ns.files.encoding import LADDER, Picture, fitted_into
from desplat_ns.files.pages import shrunk
from tests.helpers.report import flat, noise

DATA = "data:image/webp;base64,"


def opened(source: str) -> Image.Image:
    assert source.startswith(DATA)
    return Image.open(io.BytesIO(base64.b64decode(source.removeprefix(DATA))))


@pytest.mark.parametrize("budget", [300_000, 100_000, 30_000])
def test_pictures_fit_into_the_budget_whatever_their_size(budget: int):
    pictures = [Picture(noise(seed, 350, 250)) for seed in range(4)]
    encoded = fitted_into(pictures, budget)
    assert encoded.num_bytes <= budget
    assert len(encoded.sources) == 4


@pytest.mark.slow
def test_a_smaller_budget_gives_smaller_pictures():
    picture = [Picture(noise(0, 700, 500))]
    steps = [fitted_into(picture, budget) for budget in (600_000, 60_000, 15_000)]
    assert [(step.side, step.quality) for step in steps] == sorted(
        {(step.side, step.quality) for step in steps}, reverse=True
    )


def test_a_sample_of_easy_pictures_does_not_hide_hard_ones():
    """All that are sampled are flat; what is encoded in the end counts."""
    stride = 40 // 12
    pictures = [
        Picture(flat((9, 9, 9), 90, 60) if i % stride == 0 else noise(i, 90, 60)) for i in range(40)
    ]
    assert fitted_into(pictures, 130_000).num_bytes <= 130_000


def test_pictures_in_order_and_those_shown_smaller_have_fewer_pixels():
    sources = fitted_into(
        [Picture(flat((250, 0, 0), 2000, 1000)), Picture(flat((0, 250, 0), 1000, 2000), 0.5)], 10**7
    ).sources
    first, second = map(opened, sources)
    assert first.size == (LADDER[0][0], LADDER[0][0] // 2)
    assert second.size == (LADDER[0][0] // 4, LADDER[0][0] // 2)
    assert np.asarray(first)[5, 5, 0] > 200 > np.asarray(second)[5, 5, 0]


def test_small_pictures_keep_their_pixels():
    picture = noise(1, 48, 32)
    assert shrunk(picture, 48) is picture
    assert opened(fitted_into([Picture(picture)], 10**6).sources[0]).size == (48, 32)


def test_a_very_long_picture_keeps_a_side():
    assert shrunk(noise(1, 3000, 1), 100).shape == (1, 100, 3)


def test_too_many_pictures_are_refused_with_what_to_type():
    with pytest.raises(ConfigError, match=r"5 pictures .*--training-photos"):
        fitted_into([Picture(noise(seed)) for seed in range(5)], 300)


def test_no_pictures_are_no_bytes():
    assert fitted_into([], 10).num_bytes == 0
