"""Which runs there are; all are scored on the right halves of the test photos."""

from __future__ import annotations

from lab.documents import RECORDS
from lab.grid.captures import GeneratedCapture, RealCapture
from lab.grid.figures import Key
from lab.grid.runs import Run, Scene, Setting, Study
from lab.synthetic import SceneSpec

FILE = RECORDS / "photo_tourism.json"

EFFECTS = "--pipeline.model.effects"
RATES = ("--full-rate-visits", "0")
"""Splatfacto's learning rates whatever the length of a run."""


def _setting(
    what: str,
    method: str,
    appearance: str,
    background: bool,
    distractors: bool = True,
    options: tuple[str, ...] = (),
) -> Setting:
    """A method and the switches of its effects."""
    switches = (
        *(f"{EFFECTS}.appearance", appearance),
        *(f"{EFFECTS}.background", "image" if background else "off"),
        *(f"{EFFECTS}.distractors", str(distractors)),
    )
    right = ("--pipeline.evaluation.protocol", "right") if appearance == "off" else ()
    return Setting(method, (*RATES, *options, *switches, *right), what)


A, FULL = "desplat-phototourism-a-paper", "desplat-phototourism-paper"
SMALL_PHOTOS = ("--pipeline.model.num-downscales", "0")
SETTINGS = {
    "plain": _setting("nothing (Splatfacto)", A, "off", False, distractors=False),
    "distractors": _setting("distractors", A, "off", False),
    "background": _setting("distractors, background", FULL, "off", True),
    "affine": _setting("distractors, affine (`desplat-phototourism-a-paper`)", A, "affine", False),
    "sh": _setting("distractors, sh", A, "sh", False),
    "affine-background": _setting(
        "distractors, affine, background (`desplat-phototourism-paper`)", FULL, "affine", True
    ),
    "sh-background": _setting("distractors, sh, background", FULL, "sh", True),
    "desplat": _setting(
        "affine, background, and the distractors of `desplat` (`desplat-phototourism`)",
        "desplat-phototourism",
        "affine",
        True,
        options=SMALL_PHOTOS,
    ),
    "no-distractors": _setting("affine, background", FULL, "affine", True, distractors=False),
}
"""By name. lambda_s and lambda_bg are the method's."""

STEPS = {"yard": 1000, "sacre": 1000}
"""Training steps by scene: the generated one, and eight photos of Sacre Coeur."""

PARSER = ("photo-tourism-data",)
SCENES = {
    "yard": Scene(GeneratedCapture("yard", SceneSpec.tourism(7)), PARSER),
    "sacre": Scene(RealCapture("sacre_coeur"), PARSER),
}

FIGURES = ("psnr", "ssim", "psnr_before", "mask_iou", "alpha_outside_masks", "embedding_seconds")
FIGURES += ("num_static_gaussians", "num_distractor_gaussians", "train_cpu_seconds")
"""Absent where an effect is off or no masks are known."""


SEED = 42
"""The method's: each setting has one run on a scene."""


def key_of(setting: str, scene: str) -> Key:
    """What a setting's run on a scene is: its steps, photos of full size."""
    return setting, scene, 1, STEPS[scene]


PLAN = tuple(Run(*key_of(setting, scene), SEED) for scene in STEPS for setting in SETTINGS)

STUDY = Study(SETTINGS, SCENES, PLAN, FIGURES)
