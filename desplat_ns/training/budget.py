"""What schedules are read at: steps in a run of given length, time in one that ends when it is up.

Schedules are in nominal steps, those of a run of the method's own length. Times are seconds of wall
time since the process began.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from desplat_ns.errors import ConfigError

END_SECONDS = 3.0
"""For ending the process; what a save takes comes on top."""


def seconds_of(text: str, option: str = "--budget") -> float:
    """Seconds of a time such as 10min, 90s, 1h30min; a number alone is seconds.

    Args:
        option: as errors name it.

    Raises:
        ConfigError: it is not understood, or not above 0.
    """
    alone = re.fullmatch(r"\s*[\d.]+\s*", text) is not None  # `1h30` could be minutes or seconds
    unit = "s?" if alone else "s"
    pattern = rf"\s*(?:([\d.]+)\s*h)?\s*(?:([\d.]+)\s*m(?:in)?)?\s*(?:([\d.]+)\s*{unit})?\s*"
    match = re.fullmatch(pattern, text)
    try:
        parts = [float(part or 0) for part in match.groups()] if match else [0.0]
    except ValueError:
        parts = [0.0]
    seconds = sum(part * unit for part, unit in zip(parts, (3600, 60, 1), strict=False))
    if not seconds > 0:
        raise ConfigError(
            f"{option} is '{text}'; it has to be a time above 0 such as 10min, 90s or 1h30min."
        )
    return seconds


@dataclass(frozen=True)
class StepSeconds:
    """What a training step costs, by the size of its photo."""

    fixed: float
    """Seconds of a step, whatever the size: Gaussians, optimizers."""
    whole_photo: float
    """Seconds that the pixels of a photo in its full size add."""

    @classmethod
    def through(cls, whole: float, half: float) -> StepSeconds:
        """From the seconds of a step with photos of full and of half their size."""
        pixels = max(0.0, (whole - half) * 4 / 3)
        return cls(max(0.0, whole - pixels), min(pixels, whole))

    def of_pixels(self, downscale: int) -> float:
        """Seconds that the pixels of a photo add that is smaller by a factor."""
        return self.whole_photo / downscale**2


@dataclass
class BudgetState:
    """What a checkpoint keeps of a run with a budget."""

    steps: int
    """As they were planned: schedules are of this length."""
    downscale: int
    """By how much photos are smaller in the whole run."""
    most: int
    """Steps beyond which it does not go on."""
    spent: float = 0.0
    """Seconds, of this run and of those that it went on from."""
    reached: float = 0.0
    """Planned step at which the schedules are."""

    def saved(self) -> dict[str, Any]:
        """As plain values: arguments of this class."""
        return asdict(self)


class Clock:
    """What schedules are read at, in a run of given length: its steps."""

    def __init__(self, scale: float = 1.0):
        """`scale`: steps of this run for each nominal one."""
        self.scale = scale

    def nominal(self, step: int) -> int:
        """The nominal step at which the schedules are in a step of this run."""
        return round(self.at(step) / self.scale)

    def at(self, step: int) -> int | float:
        """Where the schedules are in a step, in steps of the length that was planned."""
        return step


class BudgetClock(Clock):
    """Time in place of steps: schedules come to their end when the budget does.

    Each step takes the schedules as far as the seconds that it took, of those that were left. As
    far is meant in seconds that the planned steps are expected to cost; so a machine as fast as
    expected goes through the plan step by step, and one half as fast takes two of them at once.
    """

    def __init__(
        self,
        budget: float,
        state: BudgetState,
        costs: Iterable[float],
        clock: Callable[[], float],
        scale: float = 1.0,
    ):
        """Args:
        budget: seconds in all.
        state: of the plan; is changed.
        costs: seconds that each planned step is expected to take.
        clock: seconds since the process began.
        scale: planned steps for each nominal one.
        """
        super().__init__(scale)
        self.budget, self.state = budget, state
        self.reserve = END_SECONDS
        """Seconds for what follows the last step."""
        self._until = np.cumsum([0.0, *costs])
        self._numbers = np.arange(len(self._until))
        self._clock, self._before = clock, state.spent
        self._last: tuple[int, float] | None = None
        """The step that was done last in this process, and where the schedules were in it."""

    def at(self, step: int) -> int | float:
        """Where the schedules are in the step at hand, or were in the one just done."""
        if self._last is not None and step <= self._last[0]:
            return self._last[1]
        return self.state.reached

    def spent(self) -> float:
        """Seconds, those of earlier parts of the run included."""
        return self._before + self._clock()

    def left(self) -> float:
        """Seconds for further steps."""
        return self.budget - self.reserve - self.spent()

    def after_step(self, step: int) -> None:
        """Move the schedules on when step number `step` is done.

        The first one of a process moves them by one step, however long it took: nerfstudio reads
        all photos in it. As little as that where the number of steps comes to an end, not the time.
        """
        state, now = self.state, self.spent()
        left, gone = self.budget - self.reserve - state.spent, now - state.spent
        ahead = state.steps - state.reached
        moved = ahead / max(1, state.most - step)
        if self._last is None:
            moved = max(moved, 1.0)
        else:
            moved = max(moved, self._steps_for(min(1.0, gone / left) if left > 0 else 1.0))
        self._last, state.spent = (step, state.reached), now
        state.reached += min(moved, ahead)

    def _steps_for(self, share: float) -> float:
        """Planned steps that make up a share of the seconds expected of those ahead."""
        numbers, until = self._numbers, self._until
        done = np.interp(self.state.reached, numbers, until)
        target = done + share * (until[-1] - done)
        return float(np.interp(target, until, numbers)) - self.state.reached

    def is_over(self, steps_done: int) -> bool:
        """Whether less than half a planned step is left, or no further step may be done."""
        is_at_end = self.state.steps - self.state.reached < 0.5
        return is_at_end or steps_done >= self.state.most or self.left() <= 0
