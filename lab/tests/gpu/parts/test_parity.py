from __future__ import annotations

import pytest

from desplat_ns.backend import torch_tiles
from desplat_ns.backend.tile_lists import tile_lists
from lab.gpu.parts import parity
from lab.gpu.plan import Job


@pytest.mark.slow
def test_every_backend_is_near_to_float64_in_both_references(tmp_path):
    *_, figures = parity.measure(Job("cpu", True, str(tmp_path)))
    assert {(row["reference"], row["contender"]) for row in figures["rows"]} == {
        (lists, name) for lists in (parity.EXACT, parity.SQUARES) for name in ("numba", "torch")
    }
    # A colour is a sum of weights that add up to 1; of 300 Gaussians each may be off by some eps.
    assert all(row["largest_unflipped"] < 300 * 8 * 1.2e-7 for row in figures["rows"])
    assert torch_tiles.tile_lists is tile_lists  # as it was
