"""SPZ read back by the format's own library, within half a step of each quantity."""

from __future__ import annotations

import gzip
import struct
from dataclasses import replace

import numpy as np
import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.export.spz import fractional_bits, spz_bytes
from tests.helpers.clouds import cloud, drawn, view
from tests.helpers.splat_readers import read_splats

ROUNDING = 1e-6
"""Of float32, in readers."""


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_every_value_comes_back_within_half_a_step(degree: int):
    written = cloud(count=500, degree=degree)
    found = read_splats(spz_bytes(written))
    step = 2.0 ** -fractional_bits(written.means)
    assert np.abs(found.means - written.means).max() <= step / 2 + ROUNDING
    assert np.abs(np.log(found.scales / written.scales)).max() <= 1 / 32 + ROUNDING
    assert np.abs(found.opacities - written.opacities).max() <= 1 / 510 + ROUNDING
    zeroth = np.abs(found.harmonics[:, 0] - written.harmonics[:, 0])
    assert zeroth.max() <= 0.5 / (255 * 0.15) + ROUNDING
    rest = np.abs(found.harmonics[:, 1:] - written.harmonics[:, 1:])
    assert rest[:, :3].max() <= 1 / 128 + ROUNDING
    assert degree == 1 or rest[:, 3:].max() <= 2 / 128 + ROUNDING


def test_rotations_come_back_within_half_a_step_of_each_part():
    """Three parts in steps of 1 / (511 sqrt 2); the fourth, at least 1/2, follows from them: by
    Pythagoras its error is at most (sum of |part| error) / part <= sqrt(3) / (1/2) as large."""
    written = cloud(count=2000)
    found = read_splats(spz_bytes(written))
    same_sign = np.sign((found.quats * written.quats).sum(1, keepdims=True))
    half = 0.5 / (511 * np.sqrt(2))
    assert np.abs(found.quats * same_sign - written.quats).max() <= 2 * np.sqrt(3) * half + 1e-5


def test_the_picture_stays_within_what_quantization_allows():
    """A step s leaves a mean square of s^2 / 12; the squares of a degree's harmonics sum to
    (2 degree + 1) / 4 pi. Blending only averages; shapes and opacities add a little: factor 2."""
    written = cloud(count=80)
    found = read_splats(spz_bytes(written))
    steps = np.array([1 / 38.25, 1 / 64, 1 / 32, 1 / 32])
    colors = (np.array([1, 3, 5, 7]) / (4 * np.pi) * steps**2 / 12).sum()
    error = np.square(drawn(found, view()) - drawn(written, view())).mean()
    assert error < 2 * colors


def test_precision_follows_the_scenes_size():
    small, large = cloud(), cloud()
    small = replace(small, means=small.means * 0.01)
    large = replace(large, means=large.means * 1000.0)
    assert fractional_bits(small.means) == 20
    for one in (small, large):
        step = 2.0 ** -fractional_bits(one.means)
        assert np.abs(read_splats(spz_bytes(one)).means - one.means).max() <= step / 2 * 1.01
        assert step == 2.0**-20 or np.abs(one.means).max() / step > 2**22, "a bit is wasted"


def test_what_does_not_fit_is_refused_with_what_to_do():
    far = replace(cloud(), means=cloud().means * 1e8)
    with pytest.raises(ConfigError, match=r"units from the origin.*--crop 2"):
        spz_bytes(far)


def test_values_beyond_the_formats_range_become_the_nearest_in_it():
    one = cloud(count=3)
    beyond = replace(one, harmonics=np.sign(one.harmonics) * 9, scales=one.scales * 1e-6)
    found = read_splats(spz_bytes(beyond))
    assert np.allclose(found.scales, np.exp(-10.0))
    assert np.allclose(found.harmonics[:, 0], np.sign(one.harmonics[:, 0]) / 0.3)
    assert np.allclose(found.harmonics[:, 1:], np.sign(one.harmonics[:, 1:]), atol=1 / 128)


def test_antialiased_training_is_marked():
    for antialiased, flags in ((False, 0), (True, 1)):
        content = gzip.decompress(spz_bytes(replace(cloud(), antialiased=antialiased)))
        magic, version, count, degree, _, flag, _ = struct.unpack_from("<4sIIBBBB", content)
        assert (magic, version, count, degree, flag) == (b"NGSP", 3, 40, 3, flags)


def test_the_same_scene_gives_the_same_bytes():
    assert spz_bytes(cloud()) == spz_bytes(cloud())
