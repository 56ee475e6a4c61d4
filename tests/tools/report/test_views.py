"""What training photos share, and what one alone shows."""

import torch

from desplat_ns.tools.report.views import alone, apart


def test_a_photo_that_shows_a_place_alone_is_named_with_its_share():
    shown = torch.tensor([[1, 1, 0, 0], [1, 1, 1, 1], [0, 1, 0, 0]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg", "c.jpg"], shown) == {"b.jpg": 0.5}
    twice_or_never = torch.tensor([[1, 0, 1], [1, 0, 1]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg"], twice_or_never) == {}


def test_photos_that_share_nothing_are_of_different_places():
    shown = torch.zeros(5, 400, dtype=torch.bool)
    for photo, (first, last) in enumerate([(0, 100), (95, 200), (200, 300), (298, 400), (0, 0)]):
        shown[photo, first:last] = True
    assert apart(list("abcde"), shown) == [["a", "b"], ["c", "d"]]
