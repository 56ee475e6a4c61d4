"""Which photos to take next: what one photo alone shows."""

from pathlib import Path

import torch

from desplat_ns.report.views import alone, seen_alone
from desplat_ns.runs.files import find_run
from desplat_ns.runs.loading import load_run


def test_a_photo_that_shows_a_place_alone_is_named_with_its_share_and_side():
    shown = torch.tensor([[1, 1, 0, 0], [1, 1, 1, 1], [0, 1, 0, 0]], dtype=torch.bool)
    places = torch.full((3, 4, 2), 0.5)
    places[1, 2:] = torch.tensor([0.9, 0.2])
    (photo,) = alone(["a.jpg", "b.jpg", "c.jpg"], shown, places)
    assert (photo.name, photo.share, photo.side) == ("b.jpg", 0.5, "upper right")
    twice_or_never = torch.tensor([[1, 0, 1], [1, 0, 1]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg"], twice_or_never, torch.zeros(2, 3, 2)) == []


def test_a_trained_run_is_looked_at(trained: Path):
    pipeline = load_run(find_run(trained)).pipeline
    photos = seen_alone(pipeline)
    assert {photo.name for photo in photos} <= set(pipeline.datamanager.train_image_names)
    assert all(0.1 < photo.share <= 1 for photo in photos)
