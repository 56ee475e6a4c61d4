"""A region ends where the photo's colours change."""

from __future__ import annotations

import torch

from desplat_ns.separation.regions import OUTLINE_NOISE as NOISE
from desplat_ns.separation.regions import OUTLINE_WINDOW as WINDOW
from desplat_ns.separation.regions import along_edges

ROWS, COLUMNS = 60, 80


def photo_with_a_thing() -> tuple[torch.Tensor, torch.Tensor]:
    """Colours in cells, and where the thing is."""
    torch.manual_seed(0)
    colors = torch.tensor([0.4, 0.5, 0.3])[:, None, None] + 0.02 * torch.randn(3, ROWS, COLUMNS)
    thing = torch.zeros(ROWS, COLUMNS, dtype=torch.bool)
    thing[20:40, 30:55] = True
    colors[:, thing] += torch.tensor([0.3, -0.2, 0.3])[:, None]
    return colors, thing


def grown(cells: torch.Tensor, by: int) -> torch.Tensor:
    size = 2 * by + 1
    return torch.nn.functional.max_pool2d(cells[None].float(), size, 1, by)[0] > 0


def test_a_region_that_is_too_wide_gets_the_outline_of_the_thing():
    colors, thing = photo_with_a_thing()
    assert torch.equal(along_edges(grown(thing, 2), colors), thing)


def test_one_that_is_too_narrow_comes_nearer_to_it_and_never_leaves_it():
    colors, thing = photo_with_a_thing()
    narrow = ~grown(~thing, 2)
    outline = along_edges(narrow, colors)
    assert not (outline & ~thing).any()
    assert (thing & ~outline).sum() < 0.5 * (thing & ~narrow).sum()


def test_where_no_colour_changes_a_straight_edge_stays():
    region = torch.zeros(ROWS, COLUMNS, dtype=torch.bool)
    region[:, :40] = True
    assert torch.equal(along_edges(region, torch.full((3, ROWS, COLUMNS), 0.5)), region)


def test_everything_and_nothing_stay():
    colors, _ = photo_with_a_thing()
    assert along_edges(torch.ones(ROWS, COLUMNS, dtype=torch.bool), colors).all()
    assert not along_edges(torch.zeros(ROWS, COLUMNS, dtype=torch.bool), colors).any()


def test_it_is_the_least_squares_fit_of_each_window():
    """Against numpy's least squares with the ridge as further rows, window by window."""
    colors, thing = photo_with_a_thing()
    colors, thing = colors[:, 14:34, 24:50].double(), thing[14:34, 24:50]
    rows, columns = thing.shape
    half = WINDOW // 2
    fits = torch.zeros(4, rows, columns, dtype=torch.float64)

    def window(i: int, j: int) -> tuple[slice, slice]:
        return slice(max(0, i - half), i + half + 1), slice(max(0, j - half), j + half + 1)

    for i in range(rows):
        for j in range(columns):
            at = window(i, j)
            x = colors[:, at[0], at[1]].flatten(1).T
            y = thing[at].flatten().double()
            ridge = (NOISE * len(y)) ** 0.5 * torch.eye(3, 4, dtype=torch.float64)
            left = torch.cat([torch.cat([x, torch.ones(len(y), 1).double()], 1), ridge])
            right = torch.cat([y, torch.zeros(3).double()])
            fits[:, i, j] = torch.linalg.lstsq(left, right).solution
    value = torch.zeros(rows, columns, dtype=torch.float64)
    for i in range(rows):
        for j in range(columns):
            at = window(i, j)
            mean = fits[:, at[0], at[1]].flatten(1).mean(1)
            value[i, j] = mean[:3] @ colors[:, i, j] + mean[3]
    clear = (value - 0.5).abs() > 1e-6
    assert clear.float().mean() > 0.99
    assert torch.equal(along_edges(thing, colors.float())[clear], (value > 0.5)[clear])
