"""A scene that has to fit: all of it, or what shows most, and by how much less."""

import numpy as np
import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.export.splat_cloud import SplatCloud
from desplat_ns.export.spz import spz_bytes
from desplat_ns.scene.reduction import fitted
from tests.helpers.scene import cloud
from tests.helpers.splat_readers import read_splats


def by_opacity(splats: SplatCloud) -> np.ndarray:
    return splats.opacities.astype(np.float64)


def test_what_fits_stays_whole_and_is_not_weighed():
    whole = cloud()

    def refuse(_: SplatCloud) -> np.ndarray:
        raise AssertionError("nothing has to be weighed")

    reduced = fitted(whole, len(spz_bytes(whole)), refuse)
    assert (reduced.kept, reduced.share) == (len(whole), 1.0)
    assert reduced.content == spz_bytes(whole)


@pytest.mark.parametrize("part", [0.9, 0.5])
def test_what_shows_most_is_kept_and_its_share_is_told(part: float):
    whole = cloud(count=1000)
    most = int(part * len(spz_bytes(whole)))
    reduced = fitted(whole, most, by_opacity)
    assert 0.9 * most <= len(reduced.content) <= most, "not less than need be"
    kept = np.sort(whole.opacities)[len(whole) - reduced.kept :]
    read = np.sort(read_splats(reduced.content).opacities)
    assert np.allclose(read, kept, atol=0.01), "a byte holds an opacity"
    assert reduced.share == pytest.approx(kept.sum() / whole.opacities.sum(), rel=1e-6)


@pytest.mark.parametrize("most", [1000, 0, -5])
def test_next_to_no_room_is_an_error_that_says_what_to_do(most: int):
    with pytest.raises(ConfigError, match=r"Of 300 Gaussians fewer than 100 .* --megabytes"):
        fitted(cloud(), most, by_opacity)
