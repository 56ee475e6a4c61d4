"""What other photos explain of one: photos of two textured planes, drawn ray by ray."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.rendering.views import views_of
from desplat_ns.separation.witness import Looker, Witnesses, unexplained

WIDTH, HEIGHT = 60, 40
NEAR, FAR, EDGE = 2.0, 4.0, -0.3
"""Depths of the two planes; the near one ends at this x."""

INVERSE_DEPTHS = np.append(np.linspace(1.0, 1 / 32, 64), 0.0)
THING = (slice(14, 26), slice(30, 42))
"""Cells of a thing that is pasted into a photo: on the far plane, as the middle camera sees it."""


def cameras(*places: tuple[float, float], back: Sequence[int] = ()) -> Cameras:
    """Cameras at such x and y that look along +z, y down; those in `back` look along -z."""
    poses = torch.zeros(len(places), 3, 4)
    for index, (x, y) in enumerate(places):
        turn = -1.0 if index in back else 1.0
        poses[index, :, :3] = torch.diag(torch.tensor([turn, -1.0, -turn]))
        poses[index, :2, 3] = torch.tensor([x, y])
    return Cameras(poses, 50.0, 50.0, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)


ROW = ((0.0, 0.0), (-0.4, 0.05), (-0.2, -0.05), (0.2, 0.05), (0.4, -0.05))


def texture(x: np.ndarray, y: np.ndarray, depth: float) -> np.ndarray:
    """Colours of a plane: waves of 8 to 20 cells, other ones on each plane and in each colour."""
    generator = np.random.default_rng(int(depth))
    color = np.full((*x.shape, 3), 0.5)
    for _ in range(4):
        angle, length = generator.uniform(0, np.pi, 3), generator.uniform(8, 20, 3) * depth / 50
        along = x[..., None] * np.cos(angle) + y[..., None] * np.sin(angle)
        color += 0.09 * np.sin(2 * np.pi * along / length + generator.uniform(0, 6, 3))
    return color


def photos_of(views: Cameras) -> list[Looker]:
    """What the cameras see; black where they look away."""
    lookers = []
    for view in views_of(views):
        K, viewmat = view.K.double().numpy(), view.viewmat.double().numpy()
        x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
        rays = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(K).T @ viewmat[:3, :3]
        center = -viewmat[:3, :3].T @ viewmat[:3, 3]
        at = [center + rays * ((depth - center[2]) / rays[..., 2:]) for depth in (NEAR, FAR)]
        near, far = (texture(p[..., 0], p[..., 1], p[0, 0, 2]) for p in at)
        color = np.where(at[0][..., :1] < EDGE, near, far) * (rays[..., 2:] > 0)
        lookers.append(Looker((color * 255).round().astype(np.uint8), K, viewmat))
    return lookers


def pasted(photo: Looker, shift: int = 0) -> Looker:
    """With something magenta in the way, so many cells farther left."""
    colors, (rows, columns) = photo.colors.copy(), THING
    colors[rows, columns.start - shift : columns.stop - shift] = (255, 0, 255)
    return Looker(colors, photo.K, photo.viewmat)


def inside(cells: np.ndarray) -> np.ndarray:
    """The cells of `THING`, less its rim."""
    return cells[15:25, 31:41]


# --- one photo and others -------------------------------------------------------------------------


def test_what_all_photos_show_is_explained_on_both_planes():
    photo, *others = photos_of(cameras(*ROW))
    left, _ = unexplained(photo, others, INVERSE_DEPTHS)
    near, far = left[4:-4, 10:20], left[4:-4, 32:50]  # the near plane ends in column 22
    assert not np.isnan(near).any() and not np.isnan(far).any()
    assert np.quantile(near, 0.95) < 0.03
    assert np.quantile(far, 0.95) < 0.03


def test_what_one_photo_alone_shows_is_not():
    photo, *others = photos_of(cameras(*ROW))
    assert inside(unexplained(pasted(photo), others, INVERSE_DEPTHS)[0]).min() > 0.2


def test_one_neighbour_that_shows_the_same_explains_nothing_and_two_do():
    photo, *others = photos_of(cameras(*ROW))
    # 0.2 apart they see something before the far plane 3 cells apart, and 0.4 apart 6 cells
    others[2] = pasted(others[2], 3)
    assert inside(unexplained(pasted(photo), others, INVERSE_DEPTHS)[0]).min() > 0.2
    others[3] = pasted(others[3], 6)
    assert inside(unexplained(pasted(photo), others, INVERSE_DEPTHS)[0])[3:-3, 3:-3].max() < 0.01


def test_where_fewer_than_two_others_look_nobody_knows():
    """The others are 1 to the right: at half of the depths columns up to 26 are beyond them."""
    photo, *others = photos_of(cameras((0.0, 0.0), (1.0, 0.0), (1.0, 0.1)))
    left, _ = unexplained(photo, others, INVERSE_DEPTHS)
    assert np.isnan(left[:, :24]).all()
    assert not np.isnan(left[4:-8, 28:]).any()
    assert np.isnan(unexplained(photo, others[:1], INVERSE_DEPTHS)[0]).all()
    assert np.isnan(unexplained(photo, [], INVERSE_DEPTHS)[0]).all()


def test_at_a_depth_at_which_one_other_alone_looks_it_is_enough():
    photo, *others = photos_of(cameras((0.0, 0.0), (0.2, 0.05), (1.0, -0.05)))
    left, at = unexplained(photo, others, np.linspace(0.55, 1 / 32, 64))
    # the second other sees columns 16 to 21 of the far plane, and of the near one from 25 on
    assert np.quantile(left[4:-4, 16:21], 0.95) < 0.03
    np.testing.assert_allclose(np.median(at[4:-4, 16:21]), 1 / NEAR, atol=0.02)


# --- the photos of a capture ----------------------------------------------------------------------


def points() -> torch.Tensor:
    """Of both planes."""
    generator = np.random.default_rng(0)
    x, y = generator.uniform(-1.5, 1.5, 400), generator.uniform(-1.0, 1.0, 400)
    z = np.where(x < EDGE * FAR / NEAR, NEAR, FAR)
    return torch.from_numpy(np.stack([x, y, z], -1)).float()


def witnesses(views: Cameras, photos: Sequence[Looker]) -> Witnesses:
    """All of them were kept."""
    asked = Witnesses(points(), views)
    for index, photo in enumerate(photos):
        asked.keep(index, torch.from_numpy(photo.colors).permute(2, 0, 1) / 255)
    return asked


def test_neighbours_and_depths_come_from_the_points():
    views = cameras(*ROW)
    photo, *others = photos_of(views)
    left = witnesses(views, [pasted(photo), *others]).unexplained(0)
    assert left is not None and left.shape == (HEIGHT, WIDTH)
    assert inside(left.numpy()).min() > 0.2
    assert np.quantile(left[4:-4, 10:20], 0.95) < 0.03


def test_what_two_neighbours_confirm_most_photos_may_dispute():
    """A thing on the far plane: cameras that are 0.2 farther right see it 3 cells farther left."""
    row = (0.0, 0.4, 0.6, -0.2, -0.4, -0.6, -0.8, -1.0, 0.8, 1.0)
    views = cameras(*((x, 0.0) for x in row))
    clean = photos_of(views)
    things = [pasted(photo, round(15 * x)) for x, photo in zip(row, clean, strict=True)]

    def left(with_thing: int, count: int = len(row)) -> np.ndarray:
        photos = [*things[:with_thing], *clean[with_thing:]]
        found = witnesses(views, photos[:count]).unexplained(0)
        assert found is not None
        return inside(found.numpy())[2:-2, 2:-2]

    assert left(3).min() > 0.2
    assert left(3, count=8).max() < 0.05  # seven others are too few to dispute anything
    assert left(8).max() < 0.05  # it is the scene


def test_the_exposure_of_other_photos_is_fitted_away():
    views, gains = cameras(*ROW[:3]), (0.6, 0.7, 0.8)
    photo, *others = photos_of(views)
    exposed = [Looker((o.colors * gains).astype(np.uint8), o.K, o.viewmat) for o in others]
    plain = witnesses(views, [photo, *others]).unexplained(0)
    left = witnesses(views, [photo, *exposed]).unexplained(0)
    assert plain is not None and left is not None
    # rounded down to 1 of 255 twice, divided by a gain of 0.6
    torch.testing.assert_close(left, plain, rtol=0, atol=0.015, equal_nan=True)


def test_nobody_is_asked_without_points_photos_or_two_neighbours():
    views = cameras(*ROW[:3])
    photos = photos_of(views)
    assert witnesses(views, photos).unexplained(0) is not None
    without_points = Witnesses(None, views)
    without_points.load(witnesses(views, photos).state())
    assert without_points.unexplained(0) is None
    assert witnesses(views, photos[:2]).unexplained(0) is None
    assert witnesses(views, photos[:2]).unexplained(2) is None  # it was not kept itself
    away = cameras(*ROW[:3], back=[2])
    assert witnesses(away, photos_of(away)).unexplained(0) is None


def test_a_checkpoint_holds_the_photos():
    views = cameras(*ROW)
    asked = witnesses(views, photos_of(views))
    restored = Witnesses(points(), views)
    assert restored.unexplained(0) is None  # what is known before is forgotten
    restored.load(asked.state())
    for index in range(len(ROW)):
        expected, left = asked.unexplained(index), restored.unexplained(index)
        assert expected is not None and left is not None
        torch.testing.assert_close(left, expected, rtol=0, atol=0, equal_nan=True)
