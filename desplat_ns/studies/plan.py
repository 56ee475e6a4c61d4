"""Which runs a study of a capture does, in which order, and how long they are expected to take."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from desplat_ns.settings.effects import AppearanceGrade, Effects
from desplat_ns.studies.methods import Content
from desplat_ns.studies.records import Key, Record
from desplat_ns.studies.runs import Run

METHOD = "desplat"
"""The method whose options are varied."""

SEEDS = (42, 43, 44)
"""A difference is claimed only where all were measured: `summary.verdicts`."""

BASE = "desplat"
"""The variant that the others are compared with: the method's defaults."""

LADDER = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Lengths of the base's runs, in lengths of the comparison."""

SHORTEST = 125
"""Steps of the first run, from whose time the others' is guessed. The length of the comparison is
this number, doubled some times."""

WANTED = 500
"""Steps of a comparison up to which one seed has to do: of shorter runs little can be learned."""

GROWTH = 1.5
"""A step of a longer run is expected to take this many times one of the first run, until a longer
one is done: there are more Gaussians."""

GRADES: tuple[AppearanceGrade, ...] = ("off", "camera", "affine")


class Variant(NamedTuple):
    """The method with options."""

    what: str
    """In what it differs from the defaults, in words."""
    options: tuple[str, ...]


@dataclass(frozen=True)
class Capture:
    """The capture that a study is of, how it is read, and what it calls for."""

    data: Path
    """Its folder, absolute."""
    parser: tuple[str, ...]
    """The data parser's name and options, as `ns-train` takes them; empty for the method's own."""
    content: Content
    effects: Effects
    """As a survey decided."""


def compared(base: Effects) -> dict[str, Variant]:
    """What is compared, by name, the base first; each other one differs from it in one thing. All
    are scored on right halves: the left half shows the light where photos have one of their own.

    Args:
        base: the effects that the capture calls for.
    """

    def variant(what: str, effects: Effects = base, **options: str) -> Variant:
        given = {
            "model.effects.auto": "False",
            "model.effects.distractors": str(effects.distractors),
            "model.effects.appearance": effects.appearance,
            "model.effects.background": effects.background,
            "evaluation.protocol": "half" if effects.image_light else "right",
            **{f"model.{name.replace('_', '-')}": value for name, value in options.items()},
        }
        return Variant(what, tuple(w for k, v in given.items() for w in (f"--pipeline.{k}", v)))

    with_or_without = "without" if base.distractors else "with"
    background = "constant" if base.background == "off" else "off"
    return {
        BASE: variant("the defaults"),
        "half-size": variant("photos of half their size", train_downscale="2"),
        "fewer": variant("a quarter of the static Gaussians", gaussians_per_pixel="0.0125"),
        "degree-1": variant("spherical harmonics of degree 1", sh_degree="1"),
        "distractors": variant(
            f"{with_or_without} distractors", replace(base, distractors=not base.distractors)
        ),
        **{
            f"appearance-{grade}": variant(f"appearance {grade}", replace(base, appearance=grade))
            for grade in GRADES
            if grade != base.appearance
        },
        "background": variant(f"background {background}", replace(base, background=background)),
    }


def first_run(capture: Capture) -> Run:
    """The run that is done first, whatever the plan."""
    return _run(capture, BASE, SHORTEST, SEEDS[0])


def planned(capture: Capture, steps: int, most: int) -> list[Run]:
    """All runs, the most telling first: seed after seed the base's lengths, then every variant.

    Args:
        steps: of the comparison.
        most: that a run may have.
    """
    lengths = [max(1, round(steps * length)) for length in LADDER if steps * length <= most]
    runs = [first_run(capture)]
    for seed in SEEDS:
        runs += [_run(capture, BASE, length, seed) for length in lengths[:-1]]
        runs += [_run(capture, name, steps, seed) for name in compared(capture.effects)]
        runs += [_run(capture, BASE, lengths[-1], seed)]
    return list(dict.fromkeys(runs))


def _run(capture: Capture, variant: str, steps: int, seed: int) -> Run:
    options = compared(capture.effects)[variant].options
    return Run(variant, METHOD, options, steps, seed, capture.data, capture.parser)


class Pace:
    """Expected wall seconds of runs, from the start of a process to its end.

    A run takes a + b steps: a is for imports, reading photos and evaluation, b for a step. Both
    are those of the variant's longest run that is done, or of the base's.
    """

    def __init__(self, runs: Iterable[Run], done: Mapping[Key, Record]) -> None:
        """Args:
        done: among these is that of `first_run`, and it is among `runs`.
        """
        self._known: dict[str, tuple[int, float, float]] = {}
        for run in sorted(runs, key=lambda run: run.steps):
            if (record := done.get(run.key)) is not None:
                training = record.scores["train_wall_seconds"]
                start, step = record.seconds - training, training / run.steps
                self._known[run.variant] = run.steps, start, step

    def seconds(self, run: Run) -> float:
        """Expected of a run."""
        steps, start, step = self._known.get(run.variant, self._known[BASE])
        growth = GROWTH if run.steps > steps == SHORTEST else 1.0
        return start + run.steps * step * growth


def steps_that_fit(seconds: float, pace: Pace, capture: Capture, most: int) -> int:
    """Steps of the longest comparison of which all runs fit. Of `WANTED` steps at most, those of
    the first seed have to.

    Args:
        seconds: for all runs one after another.
        pace: after the first run.
        most: steps of the method itself.
    """
    chosen = steps = SHORTEST
    while steps <= most:
        seeds = SEEDS if steps > WANTED else SEEDS[:1]
        runs = (run for run in planned(capture, steps, most) if run.seed in seeds)
        if sum(map(pace.seconds, runs)) <= seconds:
            chosen = steps
        steps *= 2
    return chosen


def fitting(
    runs: Sequence[Run], done: Mapping[Key, Record], left: Callable[[], float]
) -> Iterator[Run]:
    """The runs that are not done, in order, that are expected to end in time.

    One that does not fit is passed over: shorter ones behind it may.

    Args:
        done, left: records, and seconds that are left; looked at when a run is asked for.
    """
    waiting = [run for run in runs if run.key not in done]
    while True:
        pace = Pace(runs, done)
        run = next((run for run in waiting if pace.seconds(run) <= left()), None)
        if run is None:
            return
        waiting.remove(run)
        yield run
