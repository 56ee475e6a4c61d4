"""How far a view is from the photos, worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.backend.protocol import View
from desplat_ns.rendering.photo_angle import PhotoAngle
from desplat_ns.rendering.views import view_of

POINT = torch.zeros(1, 3)
"""What all cameras below look at, unless they are turned away."""


def around(degrees: float, radius: float = 4.0, turned: float = 0.0) -> View:
    """A camera on a circle around `POINT` that looks at it, or so far beside it."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    axis = math.radians(degrees + turned)
    back = torch.tensor([math.sin(axis), 0.0, math.cos(axis)])
    up = torch.tensor([0.0, 1.0, 0.0])
    right = torch.linalg.cross(up, back)
    place = radius * torch.tensor([sin, 0.0, cos])
    pose = torch.stack([right, up, back, place], dim=1)
    return view_of(Cameras(pose[None], 100.0, 100.0, 50.0, 50.0, 100, 100))


def angle(photos: Sequence[float], view: View, points: torch.Tensor = POINT) -> float | None:
    return PhotoAngle(points, [around(photo) for photo in photos]).degrees(view)


def test_it_is_the_angle_to_the_second_nearest_photo():
    assert angle([-50, -20, 30, 70], around(0)) == pytest.approx(30, abs=0.01)
    assert angle([-50, -20, 30, 70], around(25)) == pytest.approx(45, abs=0.01)
    assert angle([0, 0], around(0, radius=1.0)) == pytest.approx(0, abs=0.05)


def test_photos_that_do_not_show_the_point_do_not_count():
    photos = [around(10, turned=60), around(20), around(-40)]
    assert PhotoAngle(POINT, photos).degrees(around(0)) == pytest.approx(40, abs=0.01)


def test_what_fewer_than_two_photos_show_or_from_behind_is_a_right_angle_away():
    assert angle([10, 170], around(0)) == 90
    assert PhotoAngle(POINT, [around(10), around(5, turned=90)]).degrees(around(0)) == 90


def test_half_of_the_points_in_view_decide():
    seen_by_two = torch.tensor([[0.0, 0.1 * y, 0.0] for y in range(3)])
    unseen = torch.tensor([[0.0, 0.0, 3.9], [0.0, 0.0, 3.8]])  # right before the view's camera
    photos = [around(30), around(-30)]
    degrees = PhotoAngle(torch.cat([seen_by_two, unseen]), photos).degrees(around(0))
    assert degrees == pytest.approx(30, abs=0.5)
    degrees = PhotoAngle(torch.cat([seen_by_two[:1], unseen]), photos).degrees(around(0))
    assert degrees == 90


def test_a_view_without_points_and_a_capture_of_one_photo_have_none():
    assert angle([10, 20], around(0, turned=90)) is None
    assert angle([10], around(0)) is None
