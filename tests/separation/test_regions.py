"""Regions: two thresholds, gaps and holes closed."""

import pytest
import torch

from desplat_ns.separation.regions import outlier_regions

WEAK, STRONG = 0.1, 0.5


def regions(excess: torch.Tensor) -> torch.Tensor:
    return outlier_regions(excess > WEAK, excess > STRONG)


def block(*boxes: tuple[int, int, int, int], value: float = 0.2) -> torch.Tensor:
    """A map of 40 x 50 cells that is `value` in boxes of rows and columns (from, to)."""
    excess = torch.zeros(40, 50)
    for top, bottom, left, right in boxes:
        excess[top:bottom, left:right] = value
    return excess


def test_a_weak_region_counts_where_one_of_its_cells_is_strong():
    excess = block((5, 12, 5, 12), (20, 30, 20, 30))
    excess[6, 6] = 0.6
    assert torch.equal(regions(excess), block((5, 12, 5, 12)) > 0)


def test_cells_that_touch_at_a_corner_belong_together():
    excess = block((5, 12, 5, 12), (12, 20, 12, 20))
    excess[5, 5] = 0.6
    assert regions(excess)[13:19, 13:19].all()


def test_holes_are_filled_but_not_bays():
    excess = block((5, 25, 5, 25), value=0.9)
    excess[10:18, 10:18] = 0
    assert regions(excess)[5:25, 5:25].all()
    excess[10:18, 10:] = 0  # now open to the right
    assert not regions(excess)[12:16, 14:22].any()


@pytest.mark.parametrize("edge", ["top", "bottom", "left", "right"])
def test_regions_at_the_border_stay_as_they_are(edge):
    boxes = {
        "top": (0, 8, 10, 30),
        "bottom": (32, 40, 10, 30),
        "left": (10, 30, 0, 8),
        "right": (10, 30, 42, 50),
    }
    excess = block(boxes[edge], value=0.9)
    assert torch.equal(regions(excess), excess > 0)


def test_a_gap_of_one_cell_is_closed():
    excess = block((5, 15, 5, 12), (5, 15, 13, 20), value=0.9)
    assert regions(excess)[6:14, 12].all()


def test_what_is_as_small_as_a_cell_is_a_region():
    assert regions(block((5, 6, 5, 6), value=0.9)).sum() == 1


@pytest.mark.parametrize("value", [0.0, -1.0, 0.3])
def test_nothing_strong_is_nothing(value):
    assert not regions(torch.full((40, 50), value)).any()


def test_everything_strong_is_everything():
    assert regions(torch.full((40, 50), 0.9)).all()
