"""How good a scene is said to be, and why."""

from typing import Any

import cv2
import numpy as np
import pytest
import torch

from desplat_ns.tools.report import verdict
from desplat_ns.tools.report.verdict import detail_kept, found_in_words, shown_anyway


def photo() -> np.ndarray:
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 0.7)


def test_detail_is_lost_by_blur_and_not_by_light():
    by_blur = [detail_kept(photo(), cv2.GaussianBlur(photo(), (0, 0), s)) for s in (0.5, 1, 2)]
    assert 1 > by_blur[0] > 2 * by_blur[1] > 4 * by_blur[2] > 0
    assert detail_kept(photo(), photo()) == 1
    assert detail_kept(photo(), (photo() * 0.9).astype(np.uint8)) == pytest.approx(0.81, abs=0.01)


def scores(*psnrs: float, detail: float = 0.5) -> list[dict[str, Any]]:
    return [{"name": f"{i}.jpg", "psnr": psnr, "detail": detail} for i, psnr in enumerate(psnrs)]


def said(
    images: list[dict[str, Any]],
    *,
    steps: int = 3000,
    planned: int = 3000,
    wanted: int = 3000,
    photos: int = 30,
    masks=(),
    **of_photos: Any,
) -> list[str]:
    """All that is said, in the order of the page."""
    of_photos = {"twice": [], "places": [], "left_out": {}} | of_photos
    found = [
        *verdict.of_the_run(steps, planned, wanted, photos, images),
        *verdict.of_the_photos(photos, **of_photos),
        *verdict.of_the_masks(masks),
        *verdict.of_held_out(images),
    ]
    return [what for what, cure in found if cure]


def test_causes_come_before_consequences():
    assert said(scores(25, 26, 27)) == [] == said([])
    (stopped,) = said(scores(18, 19, detail=0.1), steps=372)
    assert stopped.startswith("The run has 372 of 3,000 steps") and "blurred" in stopped
    (blurred,) = said(scores(18, 19, detail=0.1), steps=600, planned=0, wanted=1200)
    assert "blurred" in blurred and "20 times" in blurred
    (short,) = said(scores(18, 19), steps=424, planned=0)
    assert short.startswith("The budget allowed 424 of the 3,000 steps")
    assert said(scores(25, 26), steps=1600, planned=0) == []
    (few,) = said(scores(25, 26, 19.9), photos=5)
    assert few.startswith("5 photos")
    first, few = said(scores(35, 36), photos=5, twice=["a.jpg"])
    assert first.startswith("1 of the held-out photos also train") and few.startswith("5 photos")


def test_holes_and_veils_of_the_worst_photo_are_named():
    images = scores(13, 16, 25, 25)
    images[0] |= {"empty": 0.165, "veiled": 0.0}
    images[1] |= {"empty": 0.011, "veiled": 0.036}
    hole, veil = said(images)
    assert "16% of the held-out photo 0.jpg" in hole and "4% of the held-out photo 1.jpg" in veil


def test_masks_are_doubtful_where_the_scene_shows_the_same_or_most_photos_have_large_ones():
    assert said([], masks=[(0.1, 0.1)] * 3 + [(0.0, 0.0)]) == []
    assert "75%" in said([], masks=[(0.1, 0.9), (0.1, 0.6), (0.0, 0.0)])[0]
    large = [(0.4, 0.0), (0.4, 0.0), (0.1, 0.0)]
    assert "2 of 3 photos have large masks" in said([], masks=large)[0]
    assert said([], masks=[(0.0, 0.0)])[0].startswith("Nothing was found")
    words = found_in_words([(0.1, 0.5), (0.3, 0.5), (0.0, 0.0)])
    assert words.endswith("in 2 of 3 photos: 20.0% of their pixels.") and not found_in_words([])


def test_a_mask_is_needless_where_photo_and_scene_are_alike():
    photo, mask = torch.zeros(2, 2, 3), torch.tensor([[1.0, 1.0], [1.0, 0.0]])[..., None]
    static = torch.tensor([[0.04, 0.5], [0.5, 0.0]])[..., None].expand(2, 2, 3)
    assert shown_anyway(photo, static, mask) == pytest.approx(1 / 3)
    assert shown_anyway(photo, static, torch.zeros_like(mask)) == 0


def test_other_places_are_named_with_their_photos():
    (apart,) = said([], places=[["a.jpg", "b.jpg", "c.jpg"], ["x.jpg", "y.jpg"]])
    assert "2 places" in apart and "a.jpg, b.jpg and 1 more; x.jpg, y.jpg" in apart
    (lost,) = said([], left_out={"another place": ["x.jpg", "y.jpg"], "blurred": ["b.jpg"]})
    assert lost.startswith("3 photos have no pose") and "another place" in lost
    (worse,) = said(scores(25, 26, 27, 12))
    assert "1 of 4" in worse and "3.jpg" in worse
