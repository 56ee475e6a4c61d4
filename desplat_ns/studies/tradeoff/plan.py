"""Which trainings a study of a capture does, and in which order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from desplat_ns.effects import AppearanceGrade, BackgroundGrade, Effects
from desplat_ns.studies.grid.runs import Run, Scene, Setting, Study
from desplat_ns.studies.tradeoff.subject import METHOD, Subject

SEEDS = (42, 43, 44)
"""A difference is claimed only where all were measured and their ranges do not overlap."""

SCENE = "capture"
"""What the capture is called in the names of runs."""

BASE = "desplat"
"""The setting that the others are compared with: the method's defaults."""

BACKEND = "torch"
"""The setting with the backend that runs anywhere: it is compared in a short run, and last, for it
takes many times as long."""

LADDER = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Lengths of the base's runs, in lengths of the comparison."""

LONGER = 8.0
"""One length more, for time that is left."""

SHORTEST = 125
"""Steps. Lengths of the comparison are this number, doubled some times."""

EVALUATIONS = 3
"""Of each run: in the end, after half of its steps, and after a quarter."""

FIGURES = (
    *("psnr", "ssim", "lpips", "mask_iou", "num_static_gaussians", "num_distractor_gaussians"),
    *("train_wall_seconds", "train_cpu_seconds"),
    *("seconds_per_image_render", "embedding_seconds"),
)
"""Kept of every run."""

MODEL = "--pipeline.model"


@dataclass(frozen=True)
class Compared:
    """A setting of the comparison."""

    what: str
    """In what it differs from the base."""
    effects: Effects
    options: tuple[str, ...] = ()

    def setting(self) -> Setting:
        """For the grid. All are scored on right halves: where photos have a light of their own, the
        left half is looked at."""
        effects = self.effects
        switches = (
            *(f"{MODEL}.effects.auto", "False"),
            *(f"{MODEL}.effects.distractors", str(effects.distractors)),
            *(f"{MODEL}.effects.appearance", effects.appearance),
            *(f"{MODEL}.effects.background", effects.background),
        )
        protocol = ("--pipeline.evaluation.protocol", "half" if effects.image_light else "right")
        return Setting(METHOD, (*switches, *protocol, *self.options), self.what)


def grades(settings: Mapping[str, Compared]) -> dict[str, Compared]:
    """Those of `compared` that differ in nothing but the light of each photo, the base first."""
    base = settings[BASE].effects
    return {
        name: one
        for name, one in settings.items()
        if replace(one.effects, appearance=base.appearance) == base and not one.options
    }


def compared(base: Effects) -> dict[str, Compared]:
    """What is compared, the base first; each other one differs from it in one thing.

    Args:
        base: the effects that the capture calls for.
    """
    return {
        BASE: Compared("the defaults", base),
        **_dials(base),
        **_switched(base),
        BACKEND: Compared("backend torch", base, (f"{MODEL}.backend", "torch")),
    }


def _dials(base: Effects) -> dict[str, Compared]:
    """What each costs accuracy or time, with the effects as they are."""
    dials = {
        "half-size": Compared("photos of half their size", base, (f"{MODEL}.train-downscale", "2")),
        "fewer": Compared(
            "a quarter of the static Gaussians at most",
            base,
            (f"{MODEL}.gaussians-per-pixel", "0.0125"),
        ),
    }
    if base.distractors:
        dials["coarse"] = Compared(
            "distractors placed half as densely", base, (f"{MODEL}.distractors.per-view", "500")
        )
    return dials


def _switched(base: Effects) -> dict[str, Compared]:
    """Each effect switched: off if it is on, else on; and the other grades of appearance."""
    on_off = "without distractors" if base.distractors else "with distractors"
    grades: tuple[AppearanceGrade, ...] = ("off", "camera", "affine")
    background: BackgroundGrade = "constant" if base.background == "off" else "off"
    return {
        "distractors": Compared(on_off, replace(base, distractors=not base.distractors)),
        **{
            f"appearance-{grade}": Compared(f"appearance {grade}", replace(base, appearance=grade))
            for grade in grades
            if grade != base.appearance
        },
        "background": Compared(f"background {background}", replace(base, background=background)),
    }


@dataclass(frozen=True)
class TrainingPlan:
    """Trainings, the most telling first."""

    steps: int
    """Of a run of the comparison."""
    settings: tuple[str, ...]
    """Those that are compared at this length, the base first."""
    most: int
    """Steps of the method itself: no run has more."""

    def runs(self) -> tuple[Run, ...]:
        """All of them, each once: seed after seed the base's lengths, then every setting."""
        first = dict.fromkeys(run for seed in SEEDS for run in self._of_seed(seed))
        longer = [self._run(BASE, LONGER, seed) for seed in SEEDS]
        backend = self._run(BACKEND, LADDER[0], SEEDS[0])
        return (*first, *(run for run in longer if run.steps <= self.most), backend)

    def _of_seed(self, seed: int) -> Iterator[Run]:
        *short, longest = (length for length in LADDER if self.steps * length <= self.most)
        yield from (self._run(BASE, length, seed) for length in short)
        yield from (self._run(setting, 1.0, seed) for setting in self.settings)
        yield self._run(BASE, longest, seed)

    def _run(self, setting: str, length: float, seed: int) -> Run:
        return Run(setting, SCENE, 1, max(1, round(self.steps * length)), seed)


def study_of(subject: Subject, plan: TrainingPlan) -> Study:
    """The grid of a capture's trainings."""
    return Study(
        {name: one.setting() for name, one in compared(subject.effects).items()},
        {SCENE: Scene(subject, subject.parser)},
        plan.runs(),
        FIGURES,
        evaluations=EVALUATIONS,
    )
