"""Which settings are compared, on which scenes they were chosen and on which they are reported."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.documents import DOCS
from benchmarks.separation.runs import FIGURES, GIVEN, SCENES, SEEDS
from desplat_ns.studies.grid.runs import Run, Setting, Study

FILE = DOCS / "accuracy_and_time.json"
"""The records."""

MODEL = "--pipeline.model"
COEFFICIENTS = (f"{MODEL}.photos-per-coefficient", "2")
FEWER = (f"{MODEL}.gaussians-per-pixel", "0.0125")

SETTINGS = {
    "base": Setting("desplat", GIVEN, "`desplat`"),
    "coefficients": Setting("desplat", (*GIVEN, *COEFFICIENTS), "two photos per coefficient"),
    "fewer": Setting("desplat", (*GIVEN, *FEWER), "a quarter of the Gaussians at most"),
    "fewer-coefficients": Setting("desplat", (*GIVEN, *FEWER, *COEFFICIENTS), "both"),
    "relocation": Setting(
        "desplat", (*GIVEN, f"{MODEL}.density-control", "relocation"), "relocation (MCMC)"
    ),
    "relocation-fewer": Setting(
        "desplat",
        (*GIVEN, f"{MODEL}.density-control", "relocation", *FEWER),
        "relocation, a quarter of the Gaussians",
    ),
    "half": Setting(
        "desplat", (*GIVEN, f"{MODEL}.train-downscale", "2"), "photos of half their size"
    ),
}

CHOSEN_ON, REPORTED_ON = ("yard8", "yard24", "clutter"), ("around", "yard16")


def downscale_of(scene: str) -> int:
    """By how much a scene's photos are reduced on disk, for every setting."""
    return 2 if scene in ("clutter", "around") else 1


def _runs(settings: str, scenes: str, steps: int, seeds: int) -> Iterator[Run]:
    for seed in SEEDS[:seeds]:
        for scene in scenes.split():
            for setting in settings.split():
                yield Run(setting, scene, downscale_of(scene), steps, seed)


FEW_VIEWS = "around yard8 yard16 yard24"
"""Scenes whose harmonics two photos per coefficient lower."""

PLAN = (
    *_runs("base coefficients", FEW_VIEWS, 1000, 3),
    *_runs("base coefficients", FEW_VIEWS, 3000, 3),
    *_runs("fewer fewer-coefficients", FEW_VIEWS, 1000, 3),
    *_runs("base", "clutter", 1000, 3),
    *_runs("relocation relocation-fewer half", "around yard24 clutter", 1000, 1),
    *_runs("base half", "clutter around", 500, 1),
    *_runs("base half", "clutter", 250, 1),
    *_runs("half", "clutter", 2000, 1),
)

STUDY = Study(SETTINGS, {name: SCENES[name] for name in (*CHOSEN_ON, *REPORTED_ON)}, PLAN, FIGURES)
