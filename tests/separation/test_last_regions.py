"""What is remembered of the regions of a view's last visit."""

import torch

from desplat_ns.separation.grid import grid_of
from desplat_ns.separation.last_regions import LastRegions
from desplat_ns.separation.visit import Visit
from tests.helpers.well_known_scene import nothing_drawn, the_view


def visit_of(width: int, height: int, index: int = 0) -> Visit:
    view = the_view()
    return Visit(index, type(view)(view.viewmat, view.K, width, height), nothing_drawn())


def test_a_view_gets_back_its_own_on_the_grid_of_its_size_now():
    last, small = LastRegions(), visit_of(60, 40)
    assert last.of(small) is None
    last.keep(small)  # found nothing out
    assert last.of(small) is None
    small.standing = torch.zeros(40, 60, dtype=torch.bool)
    small.standing[:, 30:] = True
    last.keep(small)
    found = last.of(small)
    assert found is not None
    assert torch.equal(found, small.standing)
    columns, rows = grid_of(240, 160)
    larger = last.of(visit_of(240, 160))
    assert larger is not None
    assert larger.shape == (rows, columns) != (40, 60)
    assert larger[:, columns // 2 + 1 :].all()
    assert not larger[:, : columns // 2 - 1].any()
    assert last.of(visit_of(60, 40, index=1)) is None
