"""Which trainings a study of a capture does, and in which order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from desplat_ns.settings.effects import AppearanceGrade, BackgroundGrade, Effects
from desplat_ns.studies.capture_info import METHOD, CaptureInfo
from desplat_ns.studies.runs import Run, Variant

SEEDS = (42, 43, 44)
"""A difference is claimed only where all were measured: `summary.verdicts`."""

BASE = "desplat"
"""The variant that the others are compared with: the method's defaults."""

BACKEND = "torch"
"""The variant with the backend that runs anywhere: it is compared in a short run, and last, for it
takes many times as long."""

LADDER = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Lengths of the base's runs, in lengths of the comparison."""

LONGER = 8.0
"""One length more, for time that is left."""

SHORTEST = 125
"""Steps. Lengths of the comparison are this number, doubled some times."""

EVALUATIONS = 3
"""Of each run: in the end, after half of its steps, and after a quarter."""

MODEL = "--pipeline.model"


def _variant(name: str, what: str, effects: Effects, *options: str) -> Variant:
    """All are scored on right halves: where photos have a light of their own, the left half is
    looked at."""
    switches = (
        *(f"{MODEL}.effects.auto", "False"),
        *(f"{MODEL}.effects.distractors", str(effects.distractors)),
        *(f"{MODEL}.effects.appearance", effects.appearance),
        *(f"{MODEL}.effects.background", effects.background),
    )
    protocol = ("--pipeline.evaluation.protocol", "half" if effects.image_light else "right")
    return Variant(name, what, (*switches, *protocol, *options), METHOD)


def compared(base: Effects) -> dict[str, Variant]:
    """What is compared, by name, the base first; each other one differs from it in one thing.

    Args:
        base: the effects that the capture calls for.
    """
    variants = [
        _variant(BASE, "the defaults", base),
        _variant("half-size", "photos of half their size", base, f"{MODEL}.train-downscale", "2"),
        _variant(
            "fewer",
            "a quarter of the static Gaussians at most",
            base,
            *(f"{MODEL}.gaussians-per-pixel", "0.0125"),
        ),
        _variant("degree-1", "spherical harmonics of degree 1", base, f"{MODEL}.sh-degree", "1"),
        *_switched(base),
        _variant(BACKEND, "backend torch", base, f"{MODEL}.backend", "torch"),
    ]
    return {variant.name: variant for variant in variants}


def _switched(base: Effects) -> Iterator[Variant]:
    """Each effect switched: off if it is on, else on; and the other grades of appearance."""
    if base.distractors:
        half = (f"{MODEL}.distractors.per-view", "500")
        yield _variant("coarse", "distractors placed half as densely", base, *half)
    on_off = "without distractors" if base.distractors else "with distractors"
    yield _variant("distractors", on_off, replace(base, distractors=not base.distractors))
    grades: tuple[AppearanceGrade, ...] = ("off", "camera", "affine")
    for grade in grades:
        if grade != base.appearance:
            effects = replace(base, appearance=grade)
            yield _variant(f"appearance-{grade}", f"appearance {grade}", effects)
    background: BackgroundGrade = "constant" if base.background == "off" else "off"
    effects = replace(base, background=background)
    yield _variant("background", f"background {background}", effects)


@dataclass(frozen=True)
class TrainingPlan:
    """Trainings, the most telling first."""

    steps: int
    """Of a run of the comparison."""
    variants: tuple[str, ...]
    """Those that are compared at this length, the base first."""
    most: int
    """Steps of the method itself: no run has more."""

    def runs(self, capture: CaptureInfo) -> tuple[Run, ...]:
        """All of them, each once: seed after seed the base's lengths, then every variant."""
        variants = compared(capture.effects)

        def run(name: str, length: float, seed: int) -> Run:
            steps, data = max(1, round(self.steps * length)), Path(capture.data)
            return Run(variants[name], steps, seed, data, capture.parser, EVALUATIONS)

        *short, longest = (length for length in LADDER if self.steps * length <= self.most)
        runs: dict[Run, None] = {}
        for seed in SEEDS:
            runs |= dict.fromkeys(run(BASE, length, seed) for length in short)
            runs |= dict.fromkeys(run(name, 1.0, seed) for name in self.variants)
            runs[run(BASE, longest, seed)] = None
        longer = (run(BASE, LONGER, seed) for seed in SEEDS)
        runs |= dict.fromkeys(candidate for candidate in longer if candidate.steps <= self.most)
        return (*runs, run(BACKEND, LADDER[0], SEEDS[0]))
