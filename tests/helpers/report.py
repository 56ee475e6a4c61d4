"""A made-up run, as the report's page shows it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from desplat_ns.report.notices import Notice
from desplat_ns.report.page import Contents
from desplat_ns.report.pictures import HeldOutPhoto, TrainingPhoto
from desplat_ns.report.recorded import Chart, EffectReason, Numbers

NUMBERS = Numbers(
    experiment="yard",
    method="desplat",
    capture="photos/yard",
    steps=2000,
    planned=2000,
    has_budget=False,
    num_photos=3,
    seconds=200.0,
    num_static=1200,
    num_distractors=340,
)


def noise(seed: int, width: int = 48, height: int = 32) -> np.ndarray:
    """A picture that hardly shrinks when it is compressed."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def flat(color: tuple[int, int, int], width: int = 48, height: int = 32) -> np.ndarray:
    """A picture of one colour."""
    return np.full((height, width, 3), color, np.uint8)


def training_photo(name: str, **changes: Any) -> TrainingPhoto:
    """A red photo of a blue scene, a tenth of it covered."""
    black = flat((0, 0, 0))
    red, blue = flat((200, 0, 0)), flat((0, 0, 200))
    photo = TrainingPhoto(name, red, blue, black, black, 0.1)
    return replace(photo, **changes)


def held_out_photo(name: str, **changes: Any) -> HeldOutPhoto:
    """A grey photo that is scored 25 dB."""
    grey = flat((90, 90, 90))
    figures = {"psnr": 25.0, "ssim": 0.9}
    return replace(HeldOutPhoto(name, grey, grey, grey, figures), **changes)


def contents(**changes: Any) -> Contents:
    """A page's contents: three training photos, one held out."""
    loss = ((0.0, 1.0), (1000.0, 0.1), (2000.0, 0.01))
    made_up = Contents(
        numbers=NUMBERS,
        notices=[Notice("Each photo was seen 5 times.", "Try --max-num-iterations 9000.")],
        training=[training_photo(f"photo_{number}.png") for number in range(3)],
        held_out=[held_out_photo("extra.png")],
        results={"psnr": 25.0, "ssim": 0.9, "num_images": 1, "protocol": "full image"},
        charts=[Chart("Loss", {"loss": loss}, True)],
        reasons=[EffectReason("Distractors", "on", "Something is in the way.")],
        config="outputs/yard/desplat/run/config.yml",
    )
    return replace(made_up, **changes)
