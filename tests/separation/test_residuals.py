"""A residual counts by what the other views leave at the same place."""

import math

import pytest
import torch

from desplat_ns.separation.grid import grid_of
from desplat_ns.separation.residuals import (
    MEDIAN_STEP,
    MIN_RESIDUAL,
    excess_residual,
    local_residual,
)

ROWS, COLUMNS = 20, 30


class Memory:
    """Static Gaussians, one in each cell, and the views they have seen."""

    def __init__(self) -> None:
        y, x = torch.meshgrid(torch.arange(ROWS), torch.arange(COLUMNS), indexing="ij")
        self.means2d = torch.stack([x, y], dim=-1).reshape(-1, 2) + 0.5
        self.residual_medians = torch.zeros(len(self.means2d))
        self.visible = torch.ones(len(self.means2d), dtype=torch.bool)
        self.opacities = torch.full((len(self.means2d),), 0.8)

    def see(self, residual: torch.Tensor, counted: torch.Tensor | None = None) -> torch.Tensor:
        rest = self.visible, self.opacities, self.residual_medians, counted
        excess, self.residual_medians = excess_residual(residual, self.means2d, *rest)
        return excess.values


def flat(value: float = 0.02) -> torch.Tensor:
    return torch.full((ROWS, COLUMNS), value)


def with_block(value: float) -> torch.Tensor:
    """Residuals of 0.02, and `value` in a block of 8 x 8 cells."""
    residual = flat()
    residual[6:14, 10:18] = value
    return residual


def test_a_place_that_every_view_misses_is_expected_and_an_occluder_in_one_view_is_not():
    memory = Memory()
    for _ in range(40):
        memory.see(with_block(0.2))
    hard = memory.see(with_block(0.2))[8:12, 12:16]
    assert hard.abs().max() < 0.03
    memory = Memory()
    for view in range(40):
        memory.see(with_block(0.2) if view % 8 == 0 else flat())
    occluder = memory.see(with_block(0.2))[8:12, 12:16]
    assert torch.allclose(occluder, torch.full_like(occluder, 0.18), atol=0.01)


def test_a_worse_photo_is_no_surprise():
    """All residuals three times as large, as after a reset: nothing sticks out."""
    memory = Memory()
    for _ in range(10):
        memory.see(flat())
    assert memory.see(flat(0.06)).abs().max() < 1e-6


def test_an_occluder_over_up_to_three_quarters_of_a_view_is_measured_against_the_rest():
    """And one over more is taken for the view."""
    for share, excess in ((0.7, 0.28), (0.8, 0.0)):
        residual = flat()
        residual[: int(share * ROWS)] = 0.3
        values = Memory().see(residual)[:10]
        assert torch.allclose(values, torch.full_like(values, excess), rtol=0, atol=1e-6)


def test_texture_cancels_out_and_a_shade_does_not():
    checker = (torch.arange(48)[:, None] + torch.arange(60)) % 2 * 0.2
    gray = torch.full((48, 60, 3), 0.5)
    gray = gray.permute(2, 0, 1)
    grid = grid_of(60, 48, 300)
    textured = local_residual(gray, gray + (checker - 0.1), grid)
    shaded = local_residual(gray, gray + 0.1, grid)
    assert torch.allclose(shaded, torch.full_like(shaded, 0.1), atol=1e-6)
    assert textured.max() < 0.04
    assert (local_residual(gray, gray, grid) == torch.tensor(MIN_RESIDUAL)).all()


def test_where_no_gaussian_is_the_level_of_the_view_is_expected():
    """A bare wall without Gaussians, in a scene of which twice the level is usual."""
    memory = Memory()
    memory.see(flat())
    memory.residual_medians.fill_(math.log(2.0))
    memory.means2d[memory.means2d[:, 0] > 15] = -5.0
    residual = flat()
    residual[:, 20:] = 0.2
    excess = memory.see(residual)
    assert excess[:, 23:].min() == pytest.approx(0.18, abs=1e-3)  # 0.2 - 0.02
    assert excess[:, :12].abs().max() == pytest.approx(0.02, abs=1e-3)  # 0.02 - 2 * 0.02


def test_what_is_masked_not_seen_or_beyond_the_image_learns_nothing_of_the_visit():
    memory, counted = Memory(), torch.zeros(ROWS, COLUMNS, dtype=torch.bool)
    counted[:, : COLUMNS // 2] = True
    memory.see(torch.rand(ROWS, COLUMNS) + 0.1)
    assert memory.residual_medians.abs().max() == pytest.approx(MEDIAN_STEP)
    before, kept = memory.residual_medians, ~counted.flatten()
    memory.visible[:2], memory.means2d[2:4] = False, torch.tensor([[-0.5, 3.0], [3.0, -7e8]])
    kept[:4] = True
    memory.see(torch.rand(ROWS, COLUMNS) + 0.1, counted)
    assert torch.equal(before[kept], memory.residual_medians[kept])
    assert (before != memory.residual_medians)[~kept].float().mean() > 0.9


def test_what_is_masked_has_no_part_in_the_level_and_no_excess():
    """Three quarters of the view: enough to be taken for the view, if it counted."""
    residual, counted = flat(), torch.ones(ROWS, COLUMNS, dtype=torch.bool)
    residual[:16], counted[:16] = 0.3, False
    residual[18, 20] = 0.2
    excess = Memory().see(residual, counted)
    assert (excess[:16] == 0).all()
    assert excess[18, 20] == pytest.approx(0.18)
    assert excess[16:].median() == pytest.approx(0, abs=1e-7)
    assert Memory().see(residual)[18, 20] < 0
