"""Which photos to take next: what one photo alone shows."""

from pathlib import Path

import torch

from desplat_ns.core.run_files import find_run
from desplat_ns.tools.loading import load_run
from desplat_ns.tools.report.views import alone, seen_alone


def test_a_photo_that_shows_a_place_alone_is_named_with_its_share():
    shown = torch.tensor([[1, 1, 0, 0], [1, 1, 1, 1], [0, 1, 0, 0]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg", "c.jpg"], shown) == {"b.jpg": 0.5}
    twice_or_never = torch.tensor([[1, 0, 1], [1, 0, 1]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg"], twice_or_never) == {}


def test_a_trained_run_is_looked_at(trained: Path):
    pipeline = load_run(find_run(trained)).pipeline
    photos = seen_alone(pipeline)
    assert photos.keys() <= set(pipeline.datamanager.train_image_names)
    assert all(0.1 < share <= 1 for share in photos.values())
