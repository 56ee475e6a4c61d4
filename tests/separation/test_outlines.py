"""A region ends where the photo's colours change."""

from __future__ import annotations

import torch

from desplat_ns.separation.decide import along_edges

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
