from __future__ import annotations

import pytest
import torch
from torch import Tensor

from desplat_ns.backend import RenderSettings, tile_lists
from desplat_ns.backend.constants import ALPHA_CUTOFF
from desplat_ns.backend.projection import ProjectedSplats, project
from desplat_ns.backend.tile_lists import TILE, from_tiles, inside, to_tiles
from tests.backend.scenes import TestScene, one_gaussian, random_scene

SIZE = (70, 45)


def projected(scene: TestScene) -> ProjectedSplats:
    return project(scene.splats, scene.view, RenderSettings())


def lists_of(scene: TestScene) -> tile_lists.TileLists:
    return tile_lists.tile_lists(projected(scene), *scene.size)


def pairs(lists: tile_lists.TileLists) -> set[tuple[int, int]]:
    tiles = torch.repeat_interleave(lists.counts)
    return set(zip(tiles.tolist(), lists.gaussians.tolist(), strict=True))


def visible_pairs(scene: TestScene, spacing: int = 1) -> set[tuple[int, int]]:
    """Brute force over all pixel centres of whole tiles, or over points between them too."""
    p = projected(scene)
    columns, rows = tile_lists.tile_grid(*scene.size)
    pairs = set()
    for tile in range(columns * rows):
        x0, y0 = (tile % columns) * TILE + 0.5, (tile // columns) * TILE + 0.5
        line = torch.arange((TILE - 1) * spacing + 1, dtype=torch.float64) / spacing
        ys, xs = torch.meshgrid(y0 + line, x0 + line, indexing="ij")
        d = torch.stack([xs, ys], dim=-1).reshape(-1, 1, 2) - p.means2d[0]
        xx, xy, yy = p.conics.unbind(-1)
        sigma = 0.5 * (xx * d[..., 0] ** 2 + yy * d[..., 1] ** 2) + xy * d[..., 0] * d[..., 1]
        visible = ((p.opacities * torch.exp(-sigma) >= ALPHA_CUTOFF) & (p.radii > 0)).any(dim=0)
        pairs |= {(tile, i) for i in visible.nonzero()[:, 0].tolist()}
    return pairs


def slanted_scene(seed: int) -> TestScene:
    scene = random_scene(seed, count=100, size=SIZE, opacity=(0.002, 1.0))
    scene.scales = scene.scales * torch.tensor([3.0, 0.5, 0.2])
    return scene.to(torch.float64)


@pytest.mark.parametrize("seed", range(2))
def test_every_pair_that_a_pixel_shows_is_listed(seed):
    scene = slanted_scene(seed)
    assert visible_pairs(scene) <= pairs(lists_of(scene))


def test_hardly_any_pair_is_listed_that_no_point_of_the_tile_shows():
    scene = slanted_scene(5)
    listed = pairs(lists_of(scene))
    # The rectangle between the pixel centres is tested; an ellipse may pass between two of them.
    assert len(listed - visible_pairs(scene, spacing=6)) <= 0.01 * len(listed)


def test_lists_run_from_front_to_back_and_ties_by_index():
    scene = slanted_scene(7)
    with torch.no_grad():
        scene.means[50:] = scene.means[:50]
    lists, depths = lists_of(scene), projected(scene).depths
    for start, count in zip(lists.starts.tolist(), lists.counts.tolist(), strict=True):
        row = lists.gaussians[start : start + count].tolist()
        assert row == sorted(row, key=lambda i: (depths[i].item(), i))


def test_lists_do_not_depend_on_how_many_pairs_are_tested_at_once(monkeypatch):
    scene = slanted_scene(8)
    want = lists_of(scene)
    monkeypatch.setattr(tile_lists, "PAIRS_AT_ONCE", 10)
    got = lists_of(scene)
    assert torch.equal(got.gaussians, want.gaussians) and torch.equal(got.counts, want.counts)


@pytest.mark.parametrize(("opacity", "count"), [(1 / 256, 0), (1 / 254, 1)])
def test_what_never_reaches_the_cutoff_is_not_listed(opacity, count):
    scene = one_gaussian(opacities=torch.tensor([opacity])).to(torch.float64)
    assert lists_of(scene).counts.tolist() == [count]


def test_float32_lists_hold_what_float64_lists_hold():
    for seed in range(2):
        scene = slanted_scene(seed)
        assert pairs(lists_of(scene)) <= pairs(lists_of(scene.to(torch.float32)))


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (33, 15), (64, 17)])
def test_cutting_into_tiles_and_back_is_the_identity(size):
    width, height = size
    columns, rows = tile_lists.tile_grid(width, height)
    none = torch.zeros(columns * rows, dtype=torch.int64)
    lists = tile_lists.TileLists(none[:0], none, none, columns, rows)
    image: Tensor = torch.rand(height, width, 3)
    tiles = to_tiles(image, lists)
    assert tiles.shape == (columns * rows, 3, 256)
    assert torch.equal(from_tiles(tiles, lists, size), image)
    assert inside(lists, size).sum() == width * height
