"""Who may look from where, and what nobody sees from there."""

import math

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.backend.protocol import Splats
from desplat_ns.cameras.views import view_of
from desplat_ns.tools.export.allowed_views import allowed_views, neighbours, seen_by_any

SIZE = 200


def turned(degrees: float, *place: float) -> torch.Tensor:
    """A pose in nerfstudio's axes that looks along -z, turned about its y."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    rotation = torch.tensor([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    return torch.cat([rotation, torch.tensor(place)[:, None]], dim=1)


def cameras(*poses: torch.Tensor) -> Cameras:
    """Of a right angle from side to side."""
    return Cameras(torch.stack(poses), SIZE / 2, SIZE / 2, SIZE / 2, SIZE / 2, SIZE, SIZE)


def in_a_row(*xs: float) -> Cameras:
    """Cameras on the x axis that look along -z."""
    return cameras(*(turned(0, x, 0, 0) for x in xs))


def small(*means: tuple[float, float, float], scale: float = 0.01) -> Splats:
    count, quat = len(means), torch.tensor([[1.0, 0, 0, 0]])
    shapes = torch.tensor(means), quat.repeat(count, 1), torch.full((count, 3), scale)
    return Splats(*shapes, opacities=torch.full((count,), 0.9), colors=torch.zeros(count, 3))


def test_neighbours_are_the_nearest_three_each_pair_once_but_for_those_that_look_elsewhere():
    poses = in_a_row(0, 1, 2, 3, 10).camera_to_worlds
    pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4)]
    assert neighbours(poses) == pairs
    poses = torch.stack([turned(0, 0, 0, 0), turned(89, 2, 0, 0), turned(91, 1, 0, 0)])
    assert neighbours(poses) == [(0, 1), (1, 2)]
    assert neighbours(poses[:1]) == []


def test_views_are_those_of_the_cameras_and_between_them():
    """Half-way is half the way and half the turn."""
    between = list(allowed_views(cameras(turned(10, 0, 0, 2), turned(70, 1, -4, 4))))[2]
    expected = view_of(cameras(turned(40, 0.5, -2, 3))).viewmat
    torch.testing.assert_close(between.viewmat, expected, rtol=0, atol=1e-5)
    views = list(allowed_views(in_a_row(0, 1, 4)))
    places = [-float(view.viewmat[0, 3]) for view in views]
    assert places == pytest.approx([0, 1, 4, 0.5, 2, 2.5], abs=1e-6)
    assert {(view.width, view.height) for view in views} == {(SIZE, SIZE)}


def test_what_no_image_shows_is_not_seen():
    ahead, above, behind, beside = (0, 0, -2.0), (0, 3.0, -2.0), (0, 0, 2.0), (2.5, 0, -2.0)
    views = list(allowed_views(in_a_row(0)))
    visible = seen_by_any(small(ahead, above, behind, beside), views, None, 0.0)
    assert visible.tolist() == [True, False, False, False]
    large = seen_by_any(small(above, beside, scale=0.3), views, None, 0.0)
    assert large.tolist() == [True, True], "they reach into the image"


def test_what_shows_half_way_between_two_cameras_is_seen():
    views = list(allowed_views(in_a_row(-1, 1)))
    between = small((0, 0, -0.5))
    assert seen_by_any(between, views, None, 0.0).all()
    assert not seen_by_any(between, views[:2], None, 0.0).any()


def test_what_is_too_near_for_all_that_show_it_is_not_seen():
    veil, scene = (0, 0, -0.7), (0, 0, -3.9)
    near = view_of(in_a_row(0))
    farther = view_of(cameras(turned(0, 0, 0, 1)))
    across = torch.linspace(-0.2, 0.2, 20)
    points = torch.stack([across, 0 * across, -4 + 0 * across], dim=1)  # of a wall
    assert seen_by_any(small(veil, scene), [near], points, 0.17).tolist() == [True, True]
    assert seen_by_any(small(veil, scene), [near], points, 0.18).tolist() == [False, True]
    assert seen_by_any(small(veil, scene), [near], None, 0.18).tolist() == [True, True]
    assert seen_by_any(small(veil, scene), [near, farther], points, 0.18).all()
