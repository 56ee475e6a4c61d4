"""What the photos see: what one photo alone shows."""

import torch

from desplat_ns.tools.report.views import alone


def test_a_photo_that_shows_a_place_alone_is_named_with_its_share():
    shown = torch.tensor([[1, 1, 0, 0], [1, 1, 1, 1], [0, 1, 0, 0]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg", "c.jpg"], shown) == {"b.jpg": 0.5}
    twice_or_never = torch.tensor([[1, 0, 1], [1, 0, 1]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg"], twice_or_never) == {}
