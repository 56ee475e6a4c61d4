"""How good a scene is, in words, and what would make it better: causes before consequences."""

from collections.abc import Iterator, Mapping
from statistics import median
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

BLURRED = 0.25
"""Share of the photos' finest detail in renderings, below which a scene looks blurred. Shares of
finished and unfinished runs: docs/guides/results.md, "The report"."""
FEW_PHOTOS = 8
EMPTY, VEILED = 0.05, 0.02
"""Shares of a held-out photo above which its holes, and what hangs before it, are named."""


def detail_kept(photo: UInt8[np.ndarray, "H W 3"], rendering: UInt8[np.ndarray, "H W 3"]) -> float:
    """How much of a photo's finest detail a rendering has: the energies of what is lost in half of
    the size, over one another. 1 where they are equal."""

    def energy(image: np.ndarray) -> float:
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
        size = grey.shape[1] // 2, grey.shape[0] // 2
        half = cv2.resize(cv2.GaussianBlur(grey, (0, 0), 1.0), size, interpolation=cv2.INTER_AREA)
        return float(np.square(grey - cv2.resize(half, grey.shape[1::-1])).mean())

    return energy(rendering) / max(energy(photo), 1e-6)


def verdict(
    steps: int, planned: int | None, num_photos: int, results: Mapping[str, Any]
) -> Iterator[tuple[str, str]]:
    """What is to be said of a scene before all else, each with its cure; nothing of a good one.

    Args:
        steps, planned: done, and of the whole run; None if a budget set its end.
        num_photos: training photos.
        results: of the held-out photos, `detail` among the figures of each, `empty` and `veiled`
            (`pictures.held_out_photos`) among those of the worst; empty without any.
    """
    images = results.get("images", [])
    is_blurred = bool(images) and median(image["detail"] for image in images) < BLURRED
    blur = "The scene is blurred: the finest detail of the photos is missing."
    if planned is not None and steps < planned:
        yield (
            f"The run has {steps:,} of {planned:,} steps: it was stopped, or this is one of its "
            f"earlier checkpoints.{' ' + blur if is_blurred else ''}",
            "Go on: the same `desplat` command again, or `ns-train` with --load-dir and the folder "
            "of its checkpoints.",
        )
    elif is_blurred:
        yield (
            f"{blur} Each photo was seen {steps / num_photos:.0f} times.",
            "Train anew and longer: a larger --budget, or more --max-num-iterations. If that is no "
            "help, look at the photos: shaken ones, or poses that are off, blur a scene as well.",
        )
    if num_photos < FEW_PHOTOS:
        yield (
            f"{num_photos} photos are few: what one of them shows, no other may confirm.",
            f"Add photos from other places: {FEW_PHOTOS} at least, better 20.",
        )
    holes, veils = (
        [image for image in images if image.get(gap, 0.0) > most]
        for gap, most in (("empty", EMPTY), ("veiled", VEILED))
    )
    if holes:
        worst = max(holes, key=lambda image: image["empty"])
        yield (
            f"The scene has holes: {worst['empty']:.0%} of the held-out photo {worst['name']} is "
            "empty, because hardly any training photo shows that part.",
            "Take photos from there, or look at the scene from other places only.",
        )
    if veils:
        worst = max(veils, key=lambda image: image["veiled"])
        yield (
            f"Something hangs close before the camera in {worst['veiled']:.0%} of the held-out "
            f"photo {worst['name']}: too few training photos look through that place.",
            "Take photos from there, or train with --pipeline.model.near-plane 0.5, which leaves "
            "out what is that close in all views.",
        )
