"""A made-up run, as the report's page shows it."""

from typing import Any

import numpy as np

from desplat_ns.core.effects import Effects
from desplat_ns.core.pages import Picture
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.tools.report.pictures import ShownPhoto


def noise(seed: int, width: int = 48, height: int = 32) -> np.ndarray:
    """A picture that hardly shrinks when it is compressed."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def flat(color: tuple[int, int, int], width: int = 48, height: int = 32) -> np.ndarray:
    """A picture of one colour."""
    return np.full((height, width, 3), color, np.uint8)


RED, BLUE, BLACK = (Picture(flat(color)) for color in ((200, 0, 0), (0, 0, 200), (0, 0, 0)))


def plain_photo(name: str) -> ShownPhoto:
    """A red training photo of a blue scene, in a run without distractors."""
    return ShownPhoto(name, {"photo": RED, "rendering": BLUE})


def training_photo(name: str, covered: float = 0.1) -> ShownPhoto:
    """The same, with distractors."""
    pictures = {"photo": RED, "rendering": BLUE, "distractors": BLACK, "mask": BLACK}
    return ShownPhoto(name, pictures, covered)


def held_out_photo(name: str) -> ShownPhoto:
    """A photo that is scored 25 dB."""
    pictures = {"photo": RED, "rendering": BLUE, "error": BLACK}
    return ShownPhoto(name, pictures, figures={"psnr": 25.0, "ssim": 0.9})


def contents(**changes: Any) -> dict[str, Any]:
    """What a page shows: three training photos, one held out."""
    return {
        "experiment": "yard",
        "method": "desplat",
        "capture": "photos/yard",
        "config": "outputs/yard/desplat/run/config.yml",
        "steps": 2000,
        "num_photos": 3,
        "counts": {"num_static_gaussians": 1200, "num_distractor_gaussians": 340},
        "verdict": [],
        "found": "",
        "distractors": DistractorConfig(start="residual"),
        "alone": {"photo_1.png": 0.2},
        "training": [training_photo(f"photo_{number}.png") for number in range(3)],
        "held_out": [held_out_photo("extra.png")],
        "results": {"psnr": 25.0, "ssim": 0.9, "num_images": 1, "protocol": "full image"},
        "effects": Effects(True, "camera", "off"),
        "survey": None,
        "in_the_way": ["a.jpg", "b.jpg"],
    } | changes
