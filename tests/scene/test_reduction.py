"""A scene that has to fit: all of it, or what shows most, and by how much less."""

import numpy as np
import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.export.splat_cloud import SplatCloud
from desplat_ns.export.spz import spz_bytes
from desplat_ns.scene.reduction import fitted
from tests.helpers.scene import cloud
from tests.helpers.splat_readers import read_splats


def by_opacity(one: SplatCloud) -> np.ndarray:
    return one.opacities.astype(np.float64)


def test_what_fits_stays_whole_and_is_not_weighed():
    one = cloud()

    def refuse(_: SplatCloud) -> np.ndarray:
        raise AssertionError("nothing has to be weighed")

    found = fitted(one, len(spz_bytes(one)), refuse)
    assert (found.kept, found.share) == (len(one), 1.0)
    assert found.content == spz_bytes(one)


@pytest.mark.parametrize("part", [0.9, 0.5])
def test_what_shows_most_is_kept_and_its_share_is_told(part: float):
    one = cloud(count=1000)
    most = int(part * len(spz_bytes(one)))
    found = fitted(one, most, by_opacity)
    assert 0.9 * most <= len(found.content) <= most, "not less than need be"
    kept = np.sort(one.opacities)[len(one) - found.kept :]
    read = np.sort(read_splats(found.content).opacities)
    assert np.allclose(read, kept, atol=0.01), "a byte holds an opacity"
    assert found.share == pytest.approx(kept.sum() / one.opacities.sum(), rel=1e-6)


@pytest.mark.parametrize("most", [1000, 0, -5])
def test_next_to_no_room_is_an_error_that_says_what_to_do(most: int):
    with pytest.raises(ConfigError, match=r"Of 300 Gaussians fewer than 100 .* --megabytes"):
        fitted(cloud(), most, by_opacity)
