"""A run that ends when its time is up: how many steps are planned, and how the plan is kept to.

Times are seconds of wall time since the process began. A plan is made from what a step costs on
this machine. While the run goes on, what the steps did cost corrects what is expected of the rest,
and the rest is stretched: every threshold and every learning rate that is still ahead moves by the
same factor.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

from desplat_ns.errors import ConfigError

SHARE_BETWEEN_LOOKS = 0.03
"""Of the budget. So often the plan is compared with what the steps did cost."""

NEWEST = 0.3
"""Weight of the steps since the last look in what a step is found to cost."""

LEAST_STRETCH = 0.02
"""Smaller corrections are left for later."""

END_SECONDS = 3.0
"""For ending the process; what a save takes comes on top."""


def seconds_of(text: str, option: str = "--budget") -> float:
    """Seconds of a time such as 10min, 90s, 1h30min; a number alone is seconds.

    Args:
        option: as errors name it.

    Raises:
        ConfigError: it is not understood, or not above 0.
    """
    found = re.fullmatch(r"(?:([\d.]+)\s*h)?\s*(?:([\d.]+)\s*m(?:in)?)?\s*(?:([\d.]+)\s*s?)?", text)
    try:
        parts = [float(part or 0) for part in found.groups()] if found else [0.0]
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


@dataclass(frozen=True)
class Stretch:
    """From a step on, what was planned takes `factor` times as many steps."""

    step: int
    factor: float

    def moved(self, planned: int) -> int:
        """The step to which a planned one moves; what is over stays where it was."""
        if planned <= self.step:
            return planned
        return self.step + max(1, round((planned - self.step) * self.factor))

    def planned(self, step: int | float) -> int | float:
        """The step that had been planned where the run is now."""
        return step if step <= self.step else self.step + (step - self.step) / self.factor


@dataclass
class BudgetState:
    """What a checkpoint keeps of a run with a budget."""

    steps: int
    """As they are planned now."""
    first_steps: int
    """As they were planned at first: schedules are of this length before they are stretched."""
    downscale: int
    """By how much photos are smaller in the whole run."""
    stretches: list[Stretch] = field(default_factory=list)
    spent: float = 0.0
    """Seconds, of this run and of those that it went on from."""

    @classmethod
    def from_saved(cls, saved: dict[str, Any]) -> BudgetState:
        """What `saved` gave."""
        stretches: Any = [Stretch(**one) for one in saved["stretches"]]
        return cls(**saved | {"stretches": stretches})

    def saved(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)

    def planned(self, step: int | float) -> int | float:
        """The step of the first plan that stands where the run is now."""
        for stretch in reversed(self.stretches):
            step = stretch.planned(step)
        return step


class BudgetKeeper:
    """Compares the clock with the plan, after every step."""

    def __init__(
        self,
        budget: float,
        state: BudgetState,
        cost: Callable[[int], float],
        most: int,
        clock: Callable[[], float],
    ):
        """Args:
        budget: seconds in all.
        state: of the plan; is changed.
        cost: seconds that a step is expected to take, by its number.
        most: steps beyond which a run is not lengthened.
        clock: seconds since the process began.
        """
        self.budget, self.state, self.most = budget, state, most
        self.reserve = END_SECONDS
        """Seconds for what follows the last step."""
        self._cost, self._clock, self._before = cost, clock, state.spent
        self._pace: float | None = None
        """Seconds that steps take over those that were expected."""
        self._looked: float | None = None
        self._expected = 0.0

    def spent(self) -> float:
        """Seconds, those of earlier parts of the run included."""
        return self._before + self._clock()

    def left(self) -> float:
        """Seconds for further steps."""
        return self.budget - self.reserve - self.spent()

    def after_step(self, step: int) -> Stretch | None:
        """Look at the clock when step number `step` is done.

        The first one of a process says nothing of the others: nerfstudio reads all photos in it.
        What it took is spent, and steps are timed from its end.

        Returns:
            How the steps that follow are to be stretched, if they are.
        """
        now = self.spent()
        self.state.spent = now
        if self._looked is None:
            self._looked = now
            return None
        self._expected += self._cost(step)
        if now - self._looked < SHARE_BETWEEN_LOOKS * self.budget or self._expected <= 0:
            return None
        pace = (now - self._looked) / self._expected
        self._pace = pace if self._pace is None else self._pace + NEWEST * (pace - self._pace)
        self._looked, self._expected = now, 0.0
        return self._stretch(step + 1, self._pace)

    def _stretch(self, done: int, pace: float) -> Stretch | None:
        """Stretch what is left so that it fits, if that makes a difference."""
        planned = self.state.steps - done
        ahead = pace * sum(map(self._cost, range(done, self.state.steps)))
        if planned <= 0 or ahead <= 0:
            return None
        fits = round(planned * max(0.0, self.left()) / ahead)
        steps = min(max(1, fits), max(self.most - done, planned))
        if abs(steps / planned - 1) < LEAST_STRETCH:
            return None
        stretch = Stretch(done, steps / planned)
        self.state.stretches.append(stretch)
        self.state.steps = done + steps
        return stretch

    def is_over(self, steps_done: int) -> bool:
        """Whether the last step that fits is done."""
        return steps_done >= self.state.steps or self.left() <= 0
