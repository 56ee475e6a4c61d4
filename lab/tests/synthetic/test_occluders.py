from __future__ import annotations

import numpy as np
import pytest

from desplat_ns.errors import ConfigError
from lab.synthetic.cameras import PinholeCamera, look_at
from lab.synthetic.occluders import KINDS, Effect, OccluderSpec, occluders_for_view
from lab.synthetic.primitives import Primitive
from lab.synthetic.render import draw, sky

K = np.array([[45.0, 0, 24], [0, 45, 16], [0, 0, 1]])
CAMERA = PinholeCamera(K, look_at(np.array([0.0, -5, 1.6]), np.array([0.0, 0, 1])), 48, 32)


def effect(primitives: list[Primitive]) -> Effect:
    return Effect(float(draw(primitives, CAMERA, 1, sky(CAMERA, 1)).is_new.mean()), 0.0)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_kind_stands_close_to_the_camera_and_shows(kind):
    for seed in range(5):
        parts = KINDS[kind](CAMERA, 0.5, np.random.default_rng(seed))
        samples = draw(parts, CAMERA, 1, sky(CAMERA, 1))
        assert samples.is_new.any()
        assert 0.2 < samples.depth.min() < 3.5


@pytest.mark.parametrize("limits", [(0.0, 0.05), (0.1, 0.2), (0.3, 0.5)])
def test_the_covered_fraction_lies_between_the_limits(limits):
    spec = OccluderSpec(min_fraction=limits[0], max_fraction=limits[1])
    for view in range(4):
        rng = np.random.default_rng(view)
        fraction = effect(occluders_for_view(spec, CAMERA, view, effect, rng)).covered
        assert limits[0] <= fraction <= limits[1]


def test_no_two_views_have_the_same_occluders():
    masks = []
    for view in range(4):
        parts = occluders_for_view(
            OccluderSpec(), CAMERA, view, effect, np.random.default_rng(view)
        )
        masks.append(draw(parts, CAMERA, 1, sky(CAMERA, 1)).is_new)
    for i, mask in enumerate(masks):
        for other in masks[:i]:
            assert (mask & other).sum() < 0.6 * (mask | other).sum()


def test_what_would_hide_worn_out_points_is_refused_while_there_are_other_places():
    left_is_worn_out = np.zeros((32, 48), bool)
    left_is_worn_out[:, :24] = True

    def wary(primitives: list[Primitive]) -> Effect:
        new = draw(primitives, CAMERA, 1, sky(CAMERA, 1)).is_new
        return Effect(float(new.mean()), float((new & left_is_worn_out).mean()))

    spec = OccluderSpec(min_fraction=0.1, max_fraction=0.2)
    for view in range(4):
        parts = occluders_for_view(spec, CAMERA, view, wary, np.random.default_rng(view))
        assert wary(parts).worn_out < 0.03


def test_limits_that_no_occluder_meets_are_an_error_that_names_them():
    spec = OccluderSpec(kinds=("person",), min_fraction=1e-4, max_fraction=2e-4)
    with pytest.raises(ConfigError, match=r"Widen the limits"):
        occluders_for_view(
            spec, CAMERA, 0, lambda parts: Effect(0.5, 0.0), np.random.default_rng(0)
        )


@pytest.mark.parametrize("kinds", [(), ("person", "dog")])
def test_unknown_kinds_are_an_error_that_lists_the_known_ones(kinds):
    with pytest.raises(ConfigError, match="balloon"):
        OccluderSpec(kinds=kinds)


@pytest.mark.parametrize("limits", [(0.5, 0.2), (-0.1, 0.2), (0.2, 1.2)])
def test_limits_out_of_order_are_an_error(limits):
    with pytest.raises(ConfigError, match="min_fraction"):
        OccluderSpec(min_fraction=limits[0], max_fraction=limits[1])
