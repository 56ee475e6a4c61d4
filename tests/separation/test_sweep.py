"""What other photos explain of one: photos of two textured planes, drawn ray by ray."""

import threading
from collections.abc import Sequence

import numpy as np
import pytest
import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.cameras.views import views_of
from desplat_ns.separation import sweep
from desplat_ns.separation.sweep import PlaneSweep, PosedPhoto, photo_to_sweep, unexplained

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


def photos_of(views: Cameras) -> list[PosedPhoto]:
    """What the cameras see; black where they look away."""
    photos = []
    for view in views_of(views):
        K, viewmat = view.K.double().numpy(), view.viewmat.double().numpy()
        x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
        rays = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(K).T @ viewmat[:3, :3]
        center = -viewmat[:3, :3].T @ viewmat[:3, 3]
        at = [center + rays * ((depth - center[2]) / rays[..., 2:]) for depth in (NEAR, FAR)]
        near, far = (texture(p[..., 0], p[..., 1], p[0, 0, 2]) for p in at)
        color = np.where(at[0][..., :1] < EDGE, near, far) * (rays[..., 2:] > 0)
        photos.append(PosedPhoto((color * 255).round().astype(np.uint8), K, viewmat))
    return photos


def pasted(photo: PosedPhoto, shift: int = 0) -> PosedPhoto:
    """With something magenta in the way, so many cells farther left."""
    colors, (rows, columns) = photo.colors.copy(), THING
    colors[rows, columns.start - shift : columns.stop - shift] = (255, 0, 255)
    return PosedPhoto(colors, photo.K, photo.viewmat)


def masked(photo: PosedPhoto, rows: slice, columns: slice) -> PosedPhoto:
    """With cells that the user's mask leaves out, whatever they show."""
    colors = np.dstack([photo.colors, np.full(photo.colors.shape[:2], 255, np.uint8)])
    colors[rows, columns, 3] = 0
    return PosedPhoto(colors, photo.K, photo.viewmat)


def inside(cells: np.ndarray) -> np.ndarray:
    """The cells of `THING`, less its rim."""
    return cells[15:25, 31:41]


def test_what_all_photos_show_is_explained_on_both_planes():
    photo, *others = photos_of(cameras(*ROW))
    left, _ = unexplained(photo, others, INVERSE_DEPTHS)
    near, far = left[4:-4, 10:20], left[4:-4, 32:50]  # the near plane ends in column 22
    assert not np.isnan(near).any() and not np.isnan(far).any()
    assert np.quantile(near, 0.95) < 0.03
    assert np.quantile(far, 0.95) < 0.03


def test_one_neighbour_that_shows_the_same_explains_nothing_and_two_do():
    photo, *others = photos_of(cameras(*ROW))
    # 0.2 apart they see something before the far plane 3 cells apart, and 0.4 apart 6 cells
    others[2] = pasted(others[2], 3)
    assert inside(unexplained(pasted(photo), others, INVERSE_DEPTHS)[0]).min() > 0.2
    others[3] = pasted(others[3], 6)
    assert inside(unexplained(pasted(photo), others, INVERSE_DEPTHS)[0])[3:-3, 3:-3].max() < 0.01


def test_where_fewer_than_two_others_look_nobody_knows():
    """The others are 1 to the right: columns up to 22 are beyond them at a tenth of the depths."""
    photo, *others = photos_of(cameras((0.0, 0.0), (1.0, 0.0), (1.0, 0.1)))
    left, _ = unexplained(photo, others, INVERSE_DEPTHS)
    assert np.isnan(left[:, :21]).all()
    assert not np.isnan(left[4:-8, 26:]).any()
    assert np.isnan(unexplained(photo, others[:1], INVERSE_DEPTHS)[0]).all()
    assert np.isnan(unexplained(photo, [], INVERSE_DEPTHS)[0]).all()


@pytest.mark.parametrize(("color", "others"), [(0, 255), (255, 0), (1, 255)])
def test_black_before_white_is_unexplained_and_not_unknown(color, others):
    photo, *neighbours = (
        PosedPhoto(np.full_like(each.colors, value), each.K, each.viewmat)
        for each, value in zip(photos_of(cameras(*ROW[:3])), (color, others, others), strict=True)
    )
    left, _ = unexplained(photo, neighbours, INVERSE_DEPTHS)
    assert left[4:-4, 16:-16].min() > 0.98


def test_what_is_masked_in_others_is_not_asked_and_in_the_photo_is_unknown():
    photo, *others = photos_of(cameras(*ROW))
    rows, columns = THING
    wide = rows, slice(columns.start - 12, columns.stop + 12)  # at any depth that others see
    # what three of four are asked about is not what their masks leave out
    hidden = [masked(pasted(other), *wide) for other in others[:3]]
    left, _ = unexplained(photo, [*hidden, others[3]], INVERSE_DEPTHS)
    assert np.quantile(left[4:12, 32:50], 0.95) < 0.03  # above the masks all is as it was
    middle = left[18:22, 34:38]
    assert (np.isnan(middle) | (middle < 0.03)).all()
    own, _ = unexplained(masked(pasted(photo), rows, columns), others, INVERSE_DEPTHS)
    assert np.isnan(own[rows, columns]).all()
    assert np.quantile(own[4:12, 32:50], 0.95) < 0.03


def test_a_cell_is_shown_if_the_mask_leaves_in_all_of_it():
    """400 x 400 pixels make 178 x 178 cells."""
    photo, mask = torch.full((400, 400, 3), 0.4), torch.ones(400, 400, 1, dtype=torch.bool)
    mask[100:200], photo[100:200] = False, torch.nan
    cells = photo_to_sweep(photo, mask)
    assert cells.shape == (178, 178, 4)
    shown = cells[..., 3]
    assert set(shown.unique().tolist()) == {0, 255}
    assert (shown[:44] == 255).all() and (shown[44:89] == 0).all() and (shown[89:] == 255).all()
    assert (cells[:44, :, :3] == 102).all()
    assert photo_to_sweep(photo, None).shape == (178, 178, 3)


def points(lowest: float = 1.7) -> torch.Tensor:
    """Of both planes, down to a y; the photos show 1.6 of the far one up and down."""
    generator = np.random.default_rng(0)
    x, y = generator.uniform(-2.5, 2.5, 2000), generator.uniform(-1.7, lowest, 2000)
    z = np.where(x < EDGE * FAR / NEAR, NEAR, FAR)
    return torch.from_numpy(np.stack([x, y, z], -1)).float()


def swept(views: Cameras, photos: Sequence[PosedPhoto]) -> PlaneSweep:
    """All of them were kept."""
    asked = PlaneSweep(points(), views)
    for index, photo in enumerate(photos):
        asked.keep(index, torch.from_numpy(photo.colors))
    return asked


def left_in(asked: PlaneSweep, index: int = 0, *device: torch.device) -> torch.Tensor:
    """What is unexplained of a photo, if anybody is asked."""
    left = asked.unexplained(index, *device)
    assert left is not None
    return left


def assert_same(left: torch.Tensor, other: torch.Tensor, atol: float = 0.0) -> None:
    torch.testing.assert_close(left, other, rtol=0, atol=atol, equal_nan=True)


def test_neighbours_and_depths_come_from_the_points():
    views = cameras(*ROW)
    photo, *others = photos_of(views)
    left = left_in(swept(views, [pasted(photo), *others]))
    assert left.shape == (HEIGHT, WIDTH)
    assert inside(left.numpy()).min() > 0.2
    assert np.quantile(left[4:-4, 10:20], 0.95) < 0.03


def test_below_the_lowest_point_nobody_knows():
    views = cameras(*ROW)
    asked = PlaneSweep(points(lowest=0.8), views)
    for index, photo in enumerate(photos_of(views)):
        asked.keep(index, torch.from_numpy(photo.colors))
    known = left_in(asked).isfinite()[:, 44:50]  # 0.8 is in row 30 of the far plane
    assert known[2:28].all() and not known[32:].any()
    assert left_in(swept(views, photos_of(views))).isfinite()[32:38, 44:50].all()


def test_what_two_neighbours_confirm_most_photos_may_dispute():
    """A thing on the far plane: cameras that are 0.2 farther right see it 3 cells farther left."""
    row = (0.0, 0.4, 0.6, -0.2, -0.4, -0.6, -0.8, -1.0, 0.8, 1.0)
    views = cameras(*((x, 0.0) for x in row))
    clean = photos_of(views)
    things = [pasted(photo, round(15 * x)) for x, photo in zip(row, clean, strict=True)]

    def left(with_thing: int, count: int = len(row)) -> np.ndarray:
        photos = [*things[:with_thing], *clean[with_thing:]]
        return inside(left_in(swept(views, photos[:count])).numpy())[2:-2, 2:-2]

    assert left(3).min() > 0.2
    assert left(3, count=8).max() < 0.05  # seven others are too few to dispute anything
    assert left(8).max() < 0.05  # it is the scene


def test_the_exposure_of_other_photos_is_fitted_away():
    views, gains = cameras(*ROW[:3]), (0.6, 0.7, 0.8)
    photo, *others = photos_of(views)
    exposed = [PosedPhoto((o.colors * gains).astype(np.uint8), o.K, o.viewmat) for o in others]
    plain, left = (left_in(swept(views, [photo, *some])) for some in (others, exposed))
    assert_same(left, plain, 0.015)  # rounded down to 1 of 255 twice, divided by a gain of 0.6


def test_nobody_is_asked_without_points_photos_or_two_neighbours():
    views = cameras(*ROW[:3])
    photos = photos_of(views)
    assert swept(views, photos).unexplained(0) is not None
    without_points = PlaneSweep(None, views)
    without_points.load(swept(views, photos).state())
    assert without_points.unexplained(0) is None
    assert swept(views, photos[:2]).unexplained(0) is None
    assert swept(views, photos[:2]).unexplained(2) is None  # it was not kept itself
    away = cameras(*ROW[:3], back=[2])
    assert swept(away, photos_of(away)).unexplained(0) is None


def test_exposure_is_fitted_to_what_no_mask_leaves_out():
    views = cameras(*ROW[:3])
    photo, *others = photos_of(views)
    rows, columns = slice(0, HEIGHT), slice(0, 20)
    spoiled = [masked(other, rows, columns) for other in others]
    for other in spoiled:
        other.colors[rows, columns, :3] = 255
    clean, left = (left_in(swept(views, [photo, *some])) for some in (others, spoiled))
    assert np.quantile(left[4:-4, 32:44], 0.95) < np.quantile(clean[4:-4, 32:44], 0.95) + 0.01
    hidden = [masked(other, rows, slice(0, WIDTH)) for other in others]
    assert left_in(swept(views, [photo, *hidden])).isnan().all()


def test_a_checkpoint_holds_the_photos():
    views = cameras(*ROW)
    first, *rest = photos_of(views)
    asked = swept(views, [masked(first, *THING), *rest])
    restored = PlaneSweep(points(), views)
    assert restored.unexplained(0) is None  # what is known before is forgotten
    restored.load(asked.state())
    for index in range(len(ROW)):
        assert_same(left_in(restored, index), left_in(asked, index))


def test_what_is_unexplained_does_not_depend_on_the_order_of_visits_and_is_found_once(monkeypatch):
    views = cameras(*ROW)
    photos = photos_of(views)
    ordered, other = swept(views, photos), PlaneSweep(points(), views)
    for index in (3, 0, 4, 2, 1):
        other.keep(index, torch.from_numpy(photos[index].colors))
        other.unexplained(index)  # of those that are there; not for long
    one = left_in(ordered, 2)
    assert_same(one, left_in(other, 2))
    monkeypatch.setattr(sweep, "unexplained", None)
    assert ordered.unexplained(2) is one


@pytest.fixture
def as_on_a_gpu(monkeypatch: pytest.MonkeyPatch) -> torch.device:
    """A device that is no CPU, on which results stay where they are."""
    monkeypatch.setattr(sweep, "to_device", lambda values, _: torch.from_numpy(values))
    return torch.device("meta")


def workers() -> list[threading.Thread]:
    return [t for t in threading.enumerate() if "_sweep_all" in t.name]


def test_on_a_gpu_a_thread_finds_what_is_found_on_a_cpu(as_on_a_gpu):
    views = cameras(*ROW)
    expected, asked = swept(views, photos_of(views)), swept(views, photos_of(views))
    assert not workers()
    with asked._locks[0]:  # the thread waits, and no step does
        assert asked.is_ready(0, sweep.CPU) and not asked.is_ready(0, as_on_a_gpu)
    for index in (4, 0, 2, 1, 3):  # neither first in, first out, nor what the thread is at
        assert_same(left_in(asked, index, as_on_a_gpu), left_in(expected, index))
    for worker in workers():
        worker.join(20)
    assert not workers() and all(asked.is_ready(index, as_on_a_gpu) for index in range(5))


def test_an_error_of_the_thread_is_one_of_the_step_that_asks(as_on_a_gpu, monkeypatch):
    def broken(*_: object) -> None:
        raise ValueError("broken")

    views = cameras(*ROW)
    monkeypatch.setattr(sweep, "unexplained", broken)
    asked = swept(views, photos_of(views))
    asked._work_ahead(as_on_a_gpu)
    for worker in workers():
        worker.join(20)
    with pytest.raises(ValueError, match="broken"):
        asked.unexplained(1, as_on_a_gpu)
