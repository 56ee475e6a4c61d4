"""Which settings are compared, on which scenes they were chosen and on which they are reported."""

from __future__ import annotations

from collections.abc import Iterator

from lab.documents import RECORDS
from lab.grid.runs import Run, Setting, Study
from lab.separation.runs import FIGURES, GIVEN, SCENES, SEEDS

FILE = RECORDS / "accuracy_and_time.json"
"""The records."""

AUTO_OFF = ("--pipeline.model.effects.auto", "False")

SETTINGS = {
    "base": Setting("desplat", GIVEN, "Splatfacto's rates"),
    "raised": Setting("desplat", AUTO_OFF, "**`desplat`**: rates raised in short runs"),
}

CHOSEN_ON = ("yard8", "yard24", "clutter")
REPORTED_ON = ("around", "yard16")


def downscale_of(scene: str) -> int:
    """By how much a scene's photos are reduced on disk, for every setting."""
    return 2 if scene in ("clutter", "around") else 1


def _runs(settings: str, scenes: str, steps: int, seeds: int) -> Iterator[Run]:
    for seed in SEEDS[:seeds]:
        for scene in scenes.split():
            for setting in settings.split():
                yield Run(setting, scene, downscale_of(scene), steps, seed)


PLAN = (
    *_runs("base raised", "clutter", 1000, 3),
    *_runs("base raised", "yard8", 250, 3),
    *_runs("base raised", "yard24", 1000, 3),
    *_runs("base raised", "around yard16", 500, 3),
    *_runs("base raised", "around yard16", 1000, 3),
)

FOUND = {name: SCENES[name] for name in (*CHOSEN_ON, *REPORTED_ON)}
STUDY = Study(SETTINGS, FOUND, PLAN, FIGURES)
