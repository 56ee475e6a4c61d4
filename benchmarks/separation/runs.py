"""Which runs there are: a setting on a scene, at a size, for a number of steps, with a seed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from desplat_ns.synthetic import SceneSpec

DISTRACTORS = "--pipeline.model.distractors"
OFF = ("--pipeline.model.effects.distractors", "False")


@dataclass(frozen=True)
class Setting:
    """A method and its options."""

    method: str
    options: tuple[str, ...] = ()
    what: str = ""


SETTINGS = {
    "off": Setting("desplat", OFF, "distractors off"),
    "trimmed": Setting("masked-by-residual", (), "off, trimmed loss"),
    "paper": Setting("desplat-paper", (), "`desplat-paper`"),
    "desplat": Setting("desplat", (), "**`desplat`**"),
    "truth": Setting("masked-by-truth", (), "off, true masks as weights"),
    "no-warmup": Setting("desplat", (f"{DISTRACTORS}.static-warmup", "0"), "without warm-up"),
    "shared-loss": Setting(
        "desplat", (f"{DISTRACTORS}.static-alone", "False"), "one loss for both sets"
    ),
    "everywhere": Setting(
        "desplat", (f"{DISTRACTORS}.start", "everywhere"), "distractors start everywhere"
    ),
    "lambda-paper": Setting("desplat", (f"{DISTRACTORS}.lambda-d", "0.01"), "lambda_d 0.01"),
}
"""By name. The last four are `desplat` with one thing taken away."""


HARD = ("white", "black", "large", "small", "recurring")
"""One kind of difficult occluder each."""


CLEAN = "-clean"
"""Ends the names of scenes without what is in the way: the same photos, taken before it came."""

CLUTTERED = ("robustnerf-data",)
TWINS = (*CLUTTERED, "--train-split-clean-clutter-ratio", "0")

YARDS = (8, 16, 24, 40, 60)
"""Views of the small generated scenes, which differ in nothing else."""


@dataclass(frozen=True)
class Scene:
    """A capture and how to read it."""

    parser: tuple[str, ...]
    folder: str = ""
    """In DESPLAT_NS_DATA."""
    spec: SceneSpec | None = None
    """Of a generated scene instead."""
    case: str | None = None
    """Of `hard_cases`, whose occluders take the place of the folder's."""


def _yard(views: int) -> SceneSpec:
    return SceneSpec(num_views=views, num_extras=8, width=192, height=128, seed=7)


SCENES = {
    "clutter": Scene(CLUTTERED, "fox_cluttered"),
    "clean": Scene(TWINS, "fox_cluttered"),
    "around": Scene(CLUTTERED, "monstree_cluttered"),
    "around-clean": Scene(TWINS, "monstree_cluttered"),
    "still": Scene(("colmap",), "fox"),
    "yard": Scene(CLUTTERED, spec=SceneSpec()),
    "yard-clean": Scene(TWINS, spec=SceneSpec()),
    **{f"yard{n}": Scene(CLUTTERED, spec=_yard(n)) for n in YARDS},
    **{f"yard{n}-clean": Scene(TWINS, spec=_yard(n)) for n in YARDS},
    **{name: Scene(CLUTTERED, "fox_cluttered", case=name) for name in HARD},
}
"""By name. In `still` nothing moves; `yard` is the demo's generated scene."""


@dataclass(frozen=True)
class Run:
    """One training run and its evaluation."""

    setting: str
    scene: str
    downscale: int
    steps: int
    seed: int

    @property
    def name(self) -> str:
        return f"{self.setting}-{self.scene}-{self.downscale}-{self.steps}-{self.seed}"


SEEDS = (42, 43, 44)


def _runs(settings: str, scenes: str, downscale: int, steps: int, seeds: int) -> Iterator[Run]:
    for seed in SEEDS[:seeds]:
        for scene in scenes.split():
            for setting in settings.split():
                yield Run(setting, scene, downscale, steps, seed)


OTHERS = ("around", *(f"yard{n}" for n in YARDS))
ABLATIONS = "no-warmup shared-loss everywhere lambda-paper"


def _of_others(steps: int, seeds: int) -> Iterator[Run]:
    for scene in OTHERS:
        downscale = 2 if scene == "around" else 1
        yield from _runs("off desplat", scene, downscale, steps, seeds)
        yield from _runs("off", scene + CLEAN, downscale, steps, seeds)


_WANTED = (
    *_runs("off desplat paper trimmed truth", "clutter", 2, 1000, 3),
    *_runs("off", "clean", 2, 1000, 3),
    *_runs("off desplat", "still", 2, 1000, 3),
    *_runs("off desplat paper trimmed truth", "clutter", 2, 3000, 3),
    *_runs("off", "clean", 2, 3000, 3),
    *_runs("off desplat", "still", 2, 3000, 3),
    *_of_others(1000, 3),
    *_of_others(3000, 3),
    *_of_others(7000, 1),
    *_runs("off desplat", "clutter", 2, 7000, 1),
    *_runs("off", "clean", 2, 7000, 1),
    *_runs("off desplat", "yard", 1, 1000, 3),
    *_runs("off", "yard-clean", 1, 1000, 3),
    *_runs(ABLATIONS, "clutter", 2, 1000, 1),
    *_runs("off desplat", " ".join(HARD), 2, 1000, 1),
    *_runs("off desplat", "small", 2, 1000, 3),
    *_runs(ABLATIONS, "clutter", 2, 3000, 1),
    *_runs("off desplat", " ".join(HARD), 2, 3000, 1),
    *_runs("off desplat", "yard", 1, 3000, 1),
    *_runs("off", "yard-clean", 1, 3000, 1),
    *_runs("off desplat", "clutter", 1, 3000, 1),
    *_runs("off", "clean", 1, 3000, 1),
    *_runs("off desplat", "clutter", 1, 7000, 1),
    *_runs("off", "clean", 1, 7000, 1),
    *_runs("off desplat paper truth", "clutter", 2, 30000, 1),
    *_runs("off", "clean", 2, 30000, 1),
    *_runs("off desplat", "still", 2, 30000, 1),
)
PLAN = tuple(dict.fromkeys(_WANTED))
"""Everything in the document, the quick and the important first."""
