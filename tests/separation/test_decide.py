"""Regions: two thresholds, gaps and holes closed; they end where the photo's colours change."""

import pytest
import torch

from desplat_ns.separation.decide import Thresholds, along_edges, outlier_regions, own_colors

WEAK, STRONG = 0.1, 0.5


def regions(excess: torch.Tensor) -> torch.Tensor:
    peaks = excess > STRONG
    by = Thresholds(strong_share=0.0, outline_window=1)
    found, _ = outlier_regions(excess > WEAK, torch.ones_like(peaks), peaks, peaks, by)
    return torch.zeros_like(excess) > 0 if found is None else found


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


def test_holes_are_filled_but_not_bays():
    excess = block((5, 25, 5, 25), value=0.9)
    excess[10:18, 10:18] = excess[5:25, 7] = 0  # and a gap of one cell
    assert regions(excess)[6:24, 6:24].all()
    excess[10:18, 10:] = 0  # now open to the right
    assert not regions(excess)[12:16, 14:22].any()


@pytest.mark.parametrize(
    "box",
    [(0, 8, 10, 30), (32, 40, 10, 30), (10, 30, 0, 8), (10, 30, 42, 50), (5, 6, 5, 6), (0,) * 4],
    ids=["top", "bottom", "left", "right", "one cell", "nothing"],
)
def test_regions_at_the_border_and_small_ones_stay_as_they_are(box):
    excess = block(box, value=0.9)
    assert torch.equal(regions(excess), excess > 0)


def test_what_is_behind_a_transparent_scene_is_no_difference():
    """Whatever its colour: the scene's own is compared, and an empty one contradicts nothing."""
    photo = torch.rand(3, 4, 5, generator=torch.Generator().manual_seed(0))
    scene = torch.tensor([0.1, 0.6, 0.3])[:, None, None].expand_as(photo)
    for alpha, wanted in ((0.0, photo), (0.25, (photo + scene) / 2), (0.5, scene), (1.0, scene)):
        for behind in (torch.zeros_like(photo), torch.ones_like(photo), photo):
            shown = alpha * scene + (1 - alpha) * behind
            own = own_colors(shown, torch.full_like(photo[:1], alpha), behind, photo)
            assert torch.allclose(own, wanted, atol=1e-6)


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


def test_a_region_needs_a_peak_and_strong_cells_all_over():
    weak, peaks = block((10, 20, 10, 20)) > WEAK, block((10, 11, 10, 11)) > WEAK
    for rows, is_found in ((2, False), (3, True)):  # of ten; one more touches them
        strong = block((10, 10 + rows, 10, 20)) > WEAK
        assert outlier_regions(weak, weak, strong, ~weak) == [None, None]
        large, _ = outlier_regions(weak, weak, strong, peaks)
        assert (large is not None) == is_found
        large, _ = outlier_regions(weak, peaks, strong, peaks)  # nobody knows of the others
        assert large is not None


def test_a_person_of_a_few_cells_is_judged_by_less_of_what_is_around_it():
    person, box = block((10, 16, 20, 24), value=1.0), block((20, 35, 10, 40), value=1.0)
    both = (person + box) > WEAK
    large, small = outlier_regions(both, both, both, both)
    assert large is not None and torch.equal(large, box > WEAK)
    assert small is not None and torch.equal(small, person > WEAK)
    colors = torch.rand(3, 40, 50, generator=torch.Generator().manual_seed(0))  # tell nothing apart
    assert not along_edges(small, colors).any()
    assert along_edges(small, colors, Thresholds.small_window).any()
