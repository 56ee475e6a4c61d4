"""What is remembered of the regions of a view's last visit."""

import torch

from desplat_ns.backend.protocol import View
from desplat_ns.separation.grid import grid_of
from desplat_ns.separation.last_regions import LastRegions


def view(width: int, height: int) -> View:
    return View(torch.eye(4), torch.eye(3), width, height)


def test_a_view_gets_back_its_own_on_the_grid_of_its_size_now():
    last, regions = LastRegions(), torch.zeros(40, 60, dtype=torch.bool)
    assert last.of(0, view(60, 40)) is None
    regions[:, 30:] = True
    last.keep(0, regions)
    found = last.of(0, view(60, 40))
    assert found is not None
    assert torch.equal(found, regions)
    columns, rows = grid_of(240, 160)
    larger = last.of(0, view(240, 160))
    assert larger is not None
    assert larger.shape == (rows, columns) != (40, 60)
    assert larger[:, columns // 2 + 1 :].all()
    assert not larger[:, : columns // 2 - 1].any()
    assert last.of(1, view(60, 40)) is None
