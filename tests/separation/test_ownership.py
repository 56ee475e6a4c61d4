"""What distractors own reaches beyond their edge; a region is theirs."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.separation.grid import grid_of
from desplat_ns.separation.ownership import owned_share, pixels_of

WIDTH, HEIGHT = 60, 40


def block() -> torch.Tensor:
    regions = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    regions[10:20, 30:50] = True
    return regions


def test_what_distractors_own_reaches_a_cell_beyond_their_edge():
    alpha = torch.zeros(135, 240, 1)
    alpha[50:60, 100:120] = 0.6
    alpha[90:100] = 0.4
    owned = torch.zeros(135, 240, 1)
    owned[48:62, 98:122] = 0.6
    owned[88:102] = 0.4
    assert torch.equal(owned_share(alpha), owned)


def test_a_region_is_owned_whatever_covers_it():
    height, width = 90, 160
    columns, rows = grid_of(width, height)
    regions = torch.zeros(rows, columns, dtype=torch.bool)
    regions[:, : columns // 2] = True
    owned = owned_share(torch.full((height, width, 1), 0.25), regions)
    assert torch.equal(owned == 1, pixels_of(regions, height, width))
    assert (owned[owned != 1] == 0.25).all()


@pytest.mark.parametrize("size", [(80, 120), (77, 111)])
def test_pixels_of_a_region(size):
    found = pixels_of(block(), *size)
    rows, columns = (torch.arange(n) * m // n for n, m in zip(size, (HEIGHT, WIDTH), strict=True))
    assert torch.equal(found[..., 0], block()[rows][:, columns])
