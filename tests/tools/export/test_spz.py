"""SPZ read back by the format's own library, within half a step of each quantity."""

import gzip
import struct
from dataclasses import replace

import numpy as np
import pytest

from desplat_ns.core.errors import ConfigError
from desplat_ns.tools.export.splat_cloud import OFF_BY, PRECISE, SplatCloud
from desplat_ns.tools.export.spz import fractional_bits, placed, spz_bytes
from tests.helpers.splat_files import cloud, read_splats

ROUNDING = 1e-6
"""Of float32, in readers."""


@pytest.mark.parametrize("degree", [1, 3])
def test_every_value_comes_back_within_half_a_step(degree: int):
    written = cloud(count=500, degree=degree)
    read = read_splats(spz_bytes(written))
    step = 2.0 ** -fractional_bits(np.abs(written.means).max())
    assert np.abs(read.means - written.means).max() <= step / 2 + ROUNDING
    assert np.abs(np.log(read.scales / written.scales)).max() <= 1 / 32 + ROUNDING
    assert np.abs(read.opacities - written.opacities).max() <= 1 / 510 + ROUNDING
    zeroth = np.abs(read.harmonics[:, 0] - written.harmonics[:, 0])
    assert zeroth.max() <= 0.5 / (255 * 0.15) + ROUNDING
    rest = np.abs(read.harmonics[:, 1:] - written.harmonics[:, 1:])
    assert rest[:, :3].max() <= 1 / 128 + ROUNDING
    assert degree == 1 or rest[:, 3:].max() <= 2 / 128 + ROUNDING


def test_rotations_come_back_within_half_a_step_of_each_part():
    """Three parts in steps of 1 / (511 sqrt 2); the fourth, at least 1/2, follows from them: by
    Pythagoras its error is at most (sum of |part| error) / part <= sqrt(3) / (1/2) as large."""
    written = cloud(count=2000)
    read = read_splats(spz_bytes(written))
    same_sign = np.sign((read.quats * written.quats).sum(1, keepdims=True))
    half = 0.5 / (511 * np.sqrt(2))
    assert np.abs(read.quats * same_sign - written.quats).max() <= 2 * np.sqrt(3) * half + 1e-5


def fitting(cloud: SplatCloud) -> tuple[SplatCloud, str]:
    """The Gaussians that are `placed` precisely enough, and what is said of the rest."""
    near, told = placed(cloud)
    return cloud.rows(near), told


def with_far(distance: float, count: int = 1) -> SplatCloud:
    """500 Gaussians as small as 0.08, the first so many at a distance from the origin."""
    written = cloud(count=500)
    written.means[:count, 1] = -distance
    return written


@pytest.mark.parametrize("distance", [1e5, 1e30])
def test_a_gaussian_far_away_is_left_out_and_told_and_coarsens_no_other(distance: float):
    written = with_far(distance)
    kept, told = fitting(written)
    assert np.array_equal(kept.means, written.means[1:])
    assert "1 of 500" in told and "--crop 2" in told
    places = read_splats(spz_bytes(kept)).means
    assert np.abs(places - kept.means).max() <= 2.0**-20 / 2 + ROUNDING


@pytest.mark.parametrize("distance", [10.0, 3e4])
def test_a_gaussian_far_away_stays_where_all_have_precise_places_with_it(distance: float):
    """0.08 / 32 is more than 2^-9, and 2^23 - 1 of steps of 2^-8 reach 32,767 units."""
    written = with_far(distance)
    kept, told = fitting(written)
    assert kept.means is not written.means and np.array_equal(kept.means, written.means)
    assert told == ""
    places = read_splats(spz_bytes(kept)).means
    middle = np.sort(written.scales, axis=1)[:, 1]
    off = np.abs(places - written.means).max(axis=1)
    assert (off <= OFF_BY * middle + ROUNDING * (1 + distance)).mean() >= PRECISE


@pytest.mark.parametrize("count", [4, 6, 500])
def test_more_than_a_hundredth_is_not_left_out_and_what_that_costs_is_told(count: int):
    kept, told = fitting(with_far(1e6, count))
    left_out = 4 if count == 4 else 0
    assert len(kept) == 500 - left_out
    assert f"{left_out} of 500" in told and "--crop 2" in told


def test_what_does_not_fit_is_refused_with_what_to_do():
    far = replace(cloud(), means=cloud().means * 1e8)
    with pytest.raises(ConfigError, match="--crop"):
        spz_bytes(far)


def test_values_beyond_the_formats_range_become_the_nearest_in_it():
    within = cloud(count=3)
    beyond = replace(within, harmonics=np.sign(within.harmonics) * 9, scales=within.scales * 1e-6)
    read = read_splats(spz_bytes(beyond))
    assert np.allclose(read.scales, np.exp(-10.0))
    assert np.allclose(read.harmonics[:, 0], np.sign(within.harmonics[:, 0]) / 0.3)
    assert np.allclose(read.harmonics[:, 1:], np.sign(within.harmonics[:, 1:]), atol=1 / 128)


def test_antialiased_training_is_marked():
    for antialiased, flags in ((False, 0), (True, 1)):
        content = gzip.decompress(spz_bytes(replace(cloud(), antialiased=antialiased)))
        magic, version, count, degree, _, flag, _ = struct.unpack_from("<4sIIBBBB", content)
        assert (magic, version, count, degree, flag) == (b"NGSP", 3, 40, 3, flags)
