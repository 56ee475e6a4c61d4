"""When things happen in a run: its length and its nominal steps.

Schedules (learning rates, photo sizes, refinements, resets) are functions of the nominal step, a
step of a run of the method's own length. A shorter run goes through the same nominal steps in fewer
steps of its own; their ratio is the scale, in (0, 1]. The two kinds of steps have types.
"""

import math
import re
from typing import NewType

from desplat_ns.core.errors import ConfigError

NominalStep = NewType("NominalStep", int)
RunStep = NewType("RunStep", int)
"""A step as training counts them: each draws one view, so V of them are a round of V views."""

SPLATFACTOS_INTERVAL = 100
"""Steps. Splatfacto's interval between two refinements, in which it also counts its resets."""

COUNTED_VIEWS = 40
"""A capture with fewer views is trained for as many steps as one with this number: a scene takes
shape in steps, because a step of Adam is as long as its rate."""

GPU_VISITS = 2
"""Factor on the visits of each photo on a GPU, whose steps are cheaper. Not measured."""

MOST_RATE_FACTOR = 4.0
"""Largest factor on learning rates: a factor of 6 gave no better scenes."""


def steps_for_visits(visits: float, num_views: int, at_most: int) -> int:
    """Steps in which each view is drawn `visits` times, fewer than `COUNTED_VIEWS` views more
    often; `at_most` steps."""
    return max(1, min(at_most, math.ceil(visits * max(num_views, COUNTED_VIEWS))))


def rate_factor(num_views: int, steps: int, full_visits: float) -> float:
    """Factor, 1 to `MOST_RATE_FACTOR`, on the learning rates of a run that sees photos seldom.
    `full_visits`: of each photo, for which the rates are meant; 0 for a factor of 1."""
    return min(MOST_RATE_FACTOR, max(1.0, full_visits * num_views / steps))


def early_rate_factor(step: int, warmup: int, wanted: int) -> float:
    """Factor, 1 to `MOST_RATE_FACTOR`, on the learning rates at a step of a run whose warm-up has
    fewer steps than a scene needs to take shape: wanted / warmup until it ends, then falling to 1
    at step `wanted`, where the warm-up of a run on more photos ends."""
    return min(MOST_RATE_FACTOR, max(1.0, wanted / max(step, warmup, 1)))


def settling_factor(step: int, steps: int, share: float) -> float:
    """Factor, 1 to 0, on the static set's learning rates at one of a run's nominal steps: it falls
    linearly in the last `share` of them, so that the scene ends in the middle of what single photos
    drew it to."""
    return min(1.0, max(0.0, 1.0 - step / steps) / share) if share > 0 else 1.0


class Schedule:
    """The nominal step at each step of a run of a given length."""

    def __init__(self, scale: float = 1.0):
        """`scale`: steps of the run for each nominal step."""
        self.scale = scale
        self._begun, self._reached, self._pace = 0, 0, scale

    def nominal(self, step: RunStep) -> NominalStep:
        """The nominal step that belongs to a step of the run."""
        return NominalStep(round(self._reached + (step - self._begun) / self._pace))

    def aim(self, step: RunStep, reached: int, total: int, end: float) -> None:
        """From `step` on, at which the nominal step `reached` was reached, go to the nominal step
        `end` in evenly many nominal steps each, until `total` steps of the run are done."""
        self._begun, self._reached = step, reached
        self._pace = (total - step) / max(1.0, end - reached)

    def go_on(self, step: RunStep, reached: int, total: int) -> bool:
        """Let a run that was planned for more steps, and is at nominal step `reached`, end in
        `total` steps without passing over refinements. Returns whether that changes anything."""
        if reached >= self.nominal(step) or step >= total:
            return False
        self.aim(step, reached, total, max(total, total / self.scale))
        return True


def seconds_of(text: str, option: str = "--budget") -> float:
    """Seconds of a time such as 10min, 90s, 1h30min; a number alone is seconds. Raises ConfigError,
    naming the `option`, where it is not understood or not above 0."""
    number, given = r"(\d+\.?\d*|\.\d+)", "".join(text.split())
    given += "s" * bool(re.fullmatch(number, given))
    match = re.fullmatch(rf"(?:{number}h)?(?:{number}m(?:in)?)?(?:{number}s)?", given)
    parts = [float(part or 0) for part in match.groups()] if match else [0.0] * 3
    seconds = sum(part * each for part, each in zip(parts, (3600, 60, 1), strict=True))
    if not seconds > 0:
        raise ConfigError(
            f"{option} is '{text}'; it has to be a time above 0 such as 10min, 90s or 1h30min."
        )
    return seconds
