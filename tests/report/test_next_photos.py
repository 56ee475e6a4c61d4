"""Which photos to take next: what one photo alone shows."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.report.next_photos import alone, in_words, seen_alone, side_of
from desplat_ns.runs.files import find_run
from desplat_ns.runs.loading import load_run


def test_a_photo_that_shows_a_place_alone_is_named_with_its_share_and_side():
    shown = torch.tensor([[1, 1, 0, 0], [1, 1, 1, 1], [0, 1, 0, 0]], dtype=torch.bool)
    places = torch.full((3, 4, 2), 0.5)
    places[1, 2:] = torch.tensor([0.9, 0.2])
    (photo,) = alone(["a.jpg", "b.jpg", "c.jpg"], shown, places)
    assert (photo.name, photo.share, photo.side) == ("b.jpg", 0.5, "upper right")
    what, advice = in_words([photo])
    assert "b.jpg (50%, upper right part)" in what and "step to the side" in advice


def test_nothing_is_said_where_every_place_is_seen_twice_or_never():
    shown = torch.tensor([[1, 0, 1], [1, 0, 1]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg"], shown, torch.zeros(2, 3, 2)) == []
    assert in_words([]) == ("", "")


def test_those_that_show_most_alone_come_first():
    shown = torch.tensor([[1, 1, 0, 0, 0], [0, 1, 1, 0, 0], [0, 0, 0, 1, 1]], dtype=torch.bool)
    photos = alone(["a", "b", "c"], shown, torch.zeros(3, 5, 2))
    assert [(photo.name, photo.share) for photo in photos] == [("c", 1.0), ("a", 0.5), ("b", 0.5)]


@pytest.mark.parametrize(
    ("place", "words"),
    [((0.5, 0.5), "middle"), ((0.1, 0.5), "left"), ((0.9, 0.9), "lower right")],
)
def test_parts_of_a_photo_have_names(place: tuple[float, float], words: str):
    assert side_of(torch.tensor([place])) == words


def test_a_trained_run_is_looked_at(trained):
    pipeline = load_run(find_run(trained)).pipeline
    photos = seen_alone(pipeline)
    assert {photo.name for photo in photos} <= set(pipeline.datamanager.train_image_names)
    assert all(0.1 < photo.share <= 1 for photo in photos)
