"""Timing in turns, as in `calibration.timing`, of as many cases as fit into so many seconds."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from desplat_ns.calibration.timing import REPEATS, SLOW, Timing
from lab.pixels.dial_errors import DialErrors
from lab.pixels.dial_points import DialPoint, Label
from lab.pixels.rasterizing import Cases

MOST_TURNS = 15
"""Of each fast case: the more, the less what else the machine does decides which is faster."""

FAST_ROUNDS = 4
"""Rounds before slow cases join in."""

MOST_SLOW_TURNS = 3
"""Of each slow case: a call outlasts most busy spells."""

SLOW_PAIR = 4 * SLOW
"""Seconds of a forward and a forward + backward from which a case is slow: two calls, and the first
time that it is drawn takes up to twice as long. Slow cases are timed once a turn, fast ones REPEATS
times after one call that is not counted."""

FORWARD_SHARE = 0.5
"""Seconds of a forward over those of a forward + backward: a third to a half."""


@dataclass
class Budget:
    """Seconds that may be spent."""

    seconds: float
    since: float = field(default_factory=time.perf_counter)

    @property
    def spent(self) -> float:
        return time.perf_counter() - self.since

    @property
    def left(self) -> float:
        return self.seconds - self.spent

    def unavailable_reason(self, expected: float, due: float) -> str | None:
        """Why a case cannot be admitted, if so.

        It is drawn for its errors, warmed up by a forward, and timed once at least.

        Args:
            expected: seconds of its forward + backward.
            due: seconds of turns that others are to have.
        """
        free = self.left - due
        if free <= 0:
            return f"no time was left of {self.seconds:g} s"
        if free < (2 + 2 * FORWARD_SHARE) * expected:
            return f"a call takes about {expected:.1f} s; {free:.1f} of {self.seconds:g} s are free"
        return None


@dataclass
class Case:
    """Something to time, and the points that it makes."""

    labels: Sequence[Label]
    is_default: bool
    clock: str
    errors: Sequence[DialErrors]
    """For each label: their truths differ."""
    calls: Cases
    seconds: float
    """Of a forward and a forward + backward."""
    forward: Timing = field(default_factory=Timing)
    both: Timing = field(default_factory=Timing)
    turns: int = 0

    @property
    def is_slow(self) -> bool:
        return self.seconds > SLOW_PAIR

    @property
    def turn_seconds(self) -> float:
        return self.seconds if self.is_slow else (1 + REPEATS) * self.seconds

    def take_turn(self) -> None:
        """As in `timing.time_in_turns`."""
        is_slow = self.is_slow
        for call, timing in zip(self.calls, (self.forward, self.both), strict=True):
            if not is_slow:
                call()
            for _ in range(1 if is_slow else REPEATS):
                timing.add(call)
        self.turns += 1
        self.seconds = (self.forward.wall[-1] + self.both.wall[-1]) / 1e3

    def points(self) -> list[DialPoint]:
        """One for each label."""
        is_cpu = self.clock == "CPU"
        forward, both = (t.cpu if is_cpu else t.wall for t in (self.forward, self.both))
        return [
            DialPoint(
                **vars(label),
                is_default=self.is_default,
                clock=self.clock,
                forward_ms=statistics.median(forward),
                both_ms=statistics.median(both),
                forward_range_ms=(min(forward), max(forward)),
                both_range_ms=(min(both), max(both)),
                calls=len(both),
                picture_error=errors.picture,
                picture_psnr=errors.psnr,
                gradient_error=errors.gradient,
                worst_gradient=errors.worst,
            )
            for label, errors in zip(self.labels, self.errors, strict=True)
        ]


def due_seconds(cases: Sequence[Case]) -> float:
    """Of the first turns of cases that had none."""
    return sum((case.turn_seconds for case in cases if case.turns == 0), 0.0)


def take_turns(cases: Sequence[Case], budget: Budget) -> None:
    """Give cases their turns while there is time, and to no case so many that another has none.

    Slow cases join in after some rounds. Every other round goes from the last to the first, so that
    none always follows the slow ones.
    """
    slow_rounds = range(FAST_ROUNDS, FAST_ROUNDS + MOST_SLOW_TURNS)
    gc.collect()
    gc.disable()
    try:
        for turn in range(MOST_TURNS):
            for case in cases[:: -1 if turn % 2 else 1]:
                if case.is_slow and turn not in slow_rounds:
                    continue
                is_due = case.turns == 0 and budget.left > 0
                if is_due or due_seconds(cases) + case.turn_seconds <= budget.left:
                    case.take_turn()
            gc.collect(0)  # what these calls left: nothing else is as young
    finally:
        gc.enable()
