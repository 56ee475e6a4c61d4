"""The price of distractors: steps of `desplat` against steps of the static scene alone.

    python -m lab.performance.distractors_price       (minutes)

Both have the same static Gaussians, and a step is the trainer's with its bookkeeping (`WholeStep`,
which says what is left out; that new distractors are placed is left out, too). Distractors are none
or 300 over the whole photo. A run goes through three phases: in the warm-up only the search is
added; then distractors are drawn; from `leave_out_at` on the static loss leaves out whole regions.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

from desplat_ns.calibration.timing import Timing, thread_counts, threads, time_in_turns
from desplat_ns.settings.effects import Effects
from desplat_ns.studies.machine import describe_machine
from lab.front.whole_step import SETTLED, Size, WholeStep

VIEWS = 5
PLACED = 300
"""Distractors of each view that has some."""

PHOTOS, COUNTS = ((180, 240), (270, 480), (800, 1200)), (10_000, 50_000, 200_000)
SIZES = tuple((count, *photo) for photo in PHOTOS for count in COUNTS)
"""Static Gaussians, width, height."""

WARM_UP, BEFORE, AFTER = "warm-up", "before", "after"
WARM_UPS = {WARM_UP: SETTLED + 1, BEFORE: SETTLED, AFTER: 0}
"""Length of the warm-up with which `SETTLED` lies in a phase."""

OFF = "off"
CASES: dict[str, tuple[int, str]] = {
    "warm-up": (0, WARM_UP),
    "none, before": (0, BEFORE),
    "none, after": (0, AFTER),
    f"{PLACED}, before": (PLACED, BEFORE),
    f"{PLACED}, after": (PLACED, AFTER),
}
"""Distractors of each view, and the phase."""


@dataclass(frozen=True)
class Price:
    """Steps of all cases on one scene."""

    scene: str
    threads: int
    steps: dict[str, Timing]
    """By case, `OFF` first."""

    def ratios(self, case: str) -> tuple[float, float]:
        """CPU and wall time of a case's step over that without distractors."""
        step, off = self.steps[case], self.steps[OFF]
        return step.cpu_ms / off.cpu_ms, step.wall_ms / off.wall_ms


def in_phase(step: WholeStep, phase: str) -> None:
    """Take a step as in a phase of a run."""
    layer = step.model.layer
    assert layer is not None
    layer.config = replace(layer.config, static_warmup=WARM_UPS[phase])
    step()


def cases_of(count: int, width: int, height: int) -> dict[str, Callable[[], None]]:
    """A step of each case."""
    size = Size(VIEWS, count, width, height, 0)
    off = WholeStep(size, effects=Effects(distractors=False))
    steps = {n: WholeStep(replace(size, distractors=n)) for n in (0, PLACED)}
    return {OFF: off} | {
        name: partial(in_phase, steps[number], phase) for name, (number, phase) in CASES.items()
    }


def time_price(size: tuple[int, int, int], rounds: int, numbers: list[int]) -> Iterator[Price]:
    """Time all cases on one scene, with each number of threads."""
    count, width, height = size
    cases = cases_of(*size)
    for number in numbers:
        with threads(number):
            steps = time_in_turns(cases, rounds)
        yield Price(f"{width} x {height}, {count:,}", number, steps)


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(prog="python -m lab.performance.distractors_price")
    parser.add_argument("--rounds", type=int, default=3, help="turns of each case (%(default)s)")
    parser.add_argument("--scenes", type=int, nargs="*", help="their numbers, from 0 (all)")
    parser.add_argument("--threads", type=int, nargs="*", default=thread_counts())
    options = parser.parse_args()
    print(describe_machine())
    for index in options.scenes or range(len(SIZES)):
        for price in time_price(SIZES[index], options.rounds, options.threads):
            off = price.steps[OFF]
            print(f"{price.scene}, threads {price.threads}: off {off.cpu_ms:.1f} CPU ms", end="")
            for case in CASES:
                print("; {}: {:.2f} ({:.2f})".format(case, *price.ratios(case)), end="")
            print(flush=True)


if __name__ == "__main__":
    main()
