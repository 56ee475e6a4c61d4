from __future__ import annotations

import numpy as np
import torch

from desplat_ns.backend import numba_tiles
from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.protocol import RenderSettings
from desplat_ns.calibration.scenes import Scene, make_scene
from lab.performance.pairs import count_pairs, square_entries

NEAR = 1e-4
"""Relative distance from a threshold at which float32 may decide otherwise."""


def projected_of(scene: Scene):
    with torch.no_grad():
        return numba_tiles._project(scene.splats(), scene.view, RenderSettings())


def brute_force(scene: Scene) -> tuple[int, int, int]:
    """(contributing pairs, how many are undecided, entries of tiles with a visible pixel)."""
    p, view = projected_of(scene), scene.view
    x, y = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    left = np.ones_like(x)
    is_open = np.ones_like(x, bool)
    contributing = undecided = entries = 0
    indices = [i for i in range(len(p.radii)) if p.radii[i] > 0]
    for i in sorted(indices, key=lambda i: (float(p.depths[i]), i)):
        dx, dy = x - float(p.means2d[0, i, 0]), y - float(p.means2d[0, i, 1])
        a, b, c = p.conics[i].double().tolist()
        sigma = (a * dx * dx + c * dy * dy) / 2 + b * dx * dy
        alpha = np.minimum(float(p.opacities[i]) * np.exp(-sigma), ALPHA_MAX)
        visible = alpha >= ALPHA_CUTOFF
        entries += len({(r // 16, q // 16) for r, q in zip(*np.nonzero(visible), strict=True)})
        behind = left * (1 - alpha)
        drawn = is_open & visible & (behind > TRANSMITTANCE_MIN)
        close = np.abs(alpha / ALPHA_CUTOFF - 1) < NEAR
        close |= visible & (np.abs(behind / TRANSMITTANCE_MIN - 1) < NEAR)
        undecided += int((close & is_open).sum())
        is_open &= drawn | ~visible
        left = np.where(drawn, behind, left)
        contributing += int(drawn.sum())
    return contributing, undecided, entries


def test_contributing_pairs_are_those_of_brute_force():
    scene = make_scene(300, 70, 45)
    contributing, undecided, _ = brute_force(scene)
    assert contributing > 10_000
    assert abs(count_pairs(scene).contributing - contributing) <= undecided


def test_each_count_is_contained_in_the_one_before():
    scene = make_scene(300, 70, 45)
    pairs = count_pairs(scene)
    _, _, entries = brute_force(scene)
    assert pairs.contributing < pairs.evaluated < pairs.listed < pairs.square
    # a tile between pixel centres may be listed, never one with a visible pixel left out
    assert 256 * entries <= pairs.listed <= 256 * entries * 1.05


def test_an_opaque_front_ends_the_evaluation_behind_it():
    scene = make_scene(300, 32, 32)
    before = count_pairs(scene)
    scene.params["opacities"].fill_(20.0)
    scene.params["scales"].add_(3.0)
    after = count_pairs(scene)
    assert after.listed > 2 * before.listed
    assert after.evaluated < before.evaluated / 2


def test_squares_are_counted_tile_by_tile():
    scene = make_scene(60, 70, 45)
    p = projected_of(scene)
    expected = 0
    for i in range(60):
        (x, y), r = p.means2d[0, i].tolist(), int(p.radii[i])
        if r > 0:
            expected += sum(
                x - r < 16 * column + 16
                and x + r > 16 * column
                and y - r < 16 * row + 16
                and y + r > 16 * row
                for column in range(5)
                for row in range(3)
            )
    assert square_entries(p, 70, 45) == expected
