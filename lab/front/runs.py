"""Which settings are compared, on which scenes they were chosen and on which they are reported."""

from __future__ import annotations

from collections.abc import Iterator

from lab.documents import RECORDS
from lab.grid.runs import Run, Setting, Study
from lab.separation.runs import FIGURES, GIVEN, RATES, SCENES, SEEDS
from lab.survey.runs import OWN_LIGHT
from lab.survey.runs import SCENES as SURVEYED

FILE = RECORDS / "accuracy_and_time.json"
"""The records."""

MODEL = "--pipeline.model"
COEFFICIENTS = (f"{MODEL}.photos-per-coefficient", "2")
AUTO_OFF = (f"{MODEL}.effects.auto", "False")

SETTINGS = {
    "base": Setting("desplat", GIVEN, "Splatfacto's rates"),
    "raised": Setting("desplat", AUTO_OFF, "**`desplat`**: rates raised in short runs"),
    "base-lit": Setting("desplat", OWN_LIGHT, "Splatfacto's rates, effects as the survey says"),
    "raised-lit": Setting("desplat", OWN_LIGHT[len(RATES) :], "**`desplat`**, effects likewise"),
    "coefficients": Setting(
        "desplat", (*GIVEN, *COEFFICIENTS), "two photos per coefficient, Splatfacto's rates"
    ),
}

CHOSEN_ON = ("yard8", "yard24", "yard60", "clutter")
REPORTED_ON = ("around", "yard16", "yard40", "relit", "sacre")
LIT = {"relit": "fox_relit", "sacre": "sacre_coeur"}
"""Names of the folders of scenes in which photos have a light of their own."""


def downscale_of(scene: str) -> int:
    """By how much a scene's photos are reduced on disk, for every setting."""
    return 2 if scene in ("clutter", "around", "relit") else 1


def _runs(settings: str, scenes: str, steps: int, seeds: int) -> Iterator[Run]:
    for seed in SEEDS[:seeds]:
        for scene in scenes.split():
            for setting in settings.split():
                yield Run(setting, scene, downscale_of(scene), steps, seed)


FEW_VIEWS = "around yard8 yard16 yard24"
"""Scenes whose harmonics two photos per coefficient lower."""

PLAN = (
    *_runs("base raised", "clutter", 500, 3),
    *_runs("base raised", "yard8", 250, 3),
    *_runs("base raised", "clutter yard24 yard60", 1000, 3),
    *_runs("base raised", "around yard16", 500, 3),
    *_runs("base raised", "around yard16 yard40", 1000, 3),
    *_runs("base-lit raised-lit", "relit", 1000, 3),
    *_runs("base-lit raised-lit", "sacre", 250, 3),
    *_runs("base", "yard8", 1000, 3),
    *_runs("coefficients", FEW_VIEWS, 1000, 3),
)

FOUND = {name: SCENES[name] for name in (*CHOSEN_ON, *REPORTED_ON) if name not in LIT}
LIT_SCENES = {name: SURVEYED[folder] for name, folder in LIT.items()}
STUDY = Study(SETTINGS, FOUND | LIT_SCENES, PLAN, FIGURES)
