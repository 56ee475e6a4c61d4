"""When things happen in a run: its length, its nominal steps, the clock of a budget.

Schedules (learning rates, photo sizes, refinements, resets) are functions of the nominal step, a
step of a run of the method's own length. A shorter run goes through the same nominal steps in fewer
steps of its own; their ratio is the scale, in (0, 1]. The two
kinds of steps have types, so that they are not mixed up.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NewType

from desplat_ns.core.errors import ConfigError

NominalStep = NewType("NominalStep", int)
RunStep = NewType("RunStep", int)
"""A step as training counts them: each draws one view, so V of them are a round of V views."""

SPLATFACTOS_INTERVAL = 100
"""Steps. Splatfacto's interval between two refinements, in which it also counts its resets."""

COUNTED_VIEWS = 40
"""A capture with fewer views is trained for as many steps, and at the same rates, as one with this
number: a scene takes shape in steps, because a step of Adam is as long as its rate."""

GPU_VISITS = 2
"""Factor on the visits of each photo on a GPU, whose steps are cheaper. Not measured."""

MOST_RATE_FACTOR = 4.0
"""Largest factor on learning rates: a factor of 6 gave no better scenes."""


# --- length --------------------------------------------------------------------------------------


def steps_for_visits(visits: float, num_views: int, at_most: int) -> int:
    """Steps in which each view is drawn `visits` times, fewer than `COUNTED_VIEWS` views more
    often; `at_most` steps."""
    return max(1, min(at_most, math.ceil(visits * max(num_views, COUNTED_VIEWS))))


def steps_between_refinements(
    num_views: int, densification: int, refinements: int, at_most: int
) -> int:
    """Steps of the run from one refinement of the static set to the next, half a round of the views
    at least: gradients averaged over fewer views are mostly noise.

    Args:
        densification: steps of the run until which the set is refined.
        refinements: wanted number of refinements in that time.
        at_most: upper bound on the result; 0 for none.
    """
    every = max(num_views // 2, math.ceil(densification / refinements))
    return min(every, at_most) if at_most > 0 else every


def pause_after_reset(num_views: int, reset_every: int, scale: float) -> int:
    """Nominal steps after a reset of the opacities in which no gradients are sampled, because the
    scene recovers: a round of the views and 100 steps of the run, as in Splatfacto, but at most
    half of the `reset_every` nominal steps between two resets."""
    return min(round((num_views + SPLATFACTOS_INTERVAL) / scale), reset_every // 2)


def rate_factor(num_views: int, steps: int, full_visits: float) -> float:
    """Factor, 1 to `MOST_RATE_FACTOR`, on the learning rates of a run of `steps` steps that sees
    photos seldom: rates for many visits leave a short run far from where it is heading.

    Args:
        full_visits: visits of each photo for which the rates are meant; 0 for a factor of 1.
    """
    full = full_visits * max(num_views, COUNTED_VIEWS)
    return min(MOST_RATE_FACTOR, max(1.0, full / steps))


def early_rate_factor(step: int, warmup: int, wanted: int) -> float:
    """Factor, 1 to `MOST_RATE_FACTOR`, on the learning rates at a step of a run whose warm-up has
    fewer steps than a scene needs to take shape: wanted / warmup until it ends, then falling to 1
    at step `wanted`, where the warm-up of a run on more photos ends."""
    return min(MOST_RATE_FACTOR, max(1.0, wanted / max(step, warmup, 1)))


# --- position ------------------------------------------------------------------------------------


class Schedule:
    """The nominal step at each step of a run of a given length."""

    def __init__(self, scale: float = 1.0, plan: BudgetPlan | None = None):
        """`scale`: steps of the run for each nominal step. `plan`: of a run with a budget, whose
        clock says where it stands."""
        self.scale, self.plan = scale, plan
        self._begun, self._reached, self._pace = 0, 0, scale

    def nominal(self, step: RunStep) -> NominalStep:
        """The nominal step that belongs to a step of the run."""
        if self.plan is not None:
            return NominalStep(round(self.plan.reached / self.scale))
        return NominalStep(round(self._reached + (step - self._begun) / self._pace))

    def go_on(self, step: RunStep, reached: int, total: int) -> bool:
        """Let a run that was planned for more steps reach its end in `total` steps, from the
        nominal step that it has reached at `step`: else refinements that were to come are passed
        over. Returns whether that changes anything; a run planned for fewer steps goes back."""
        end = max(total, total / self.scale)
        if self.plan is not None or reached >= self.nominal(step) or step >= total:
            return False
        self._begun, self._reached = step, reached
        self._pace = (total - step) / (end - reached)
        return True


STEPS_WANTED = 500
"""Photos are trained on at half of their size where fewer steps fit."""

FEWEST_STEPS = 200
"""A budget for fewer steps is refused, unless fewer are asked for."""

END_SECONDS = 3.0
"""Reserved for the last checkpoint and the end of the process."""


@dataclass
class BudgetPlan:
    """What a budget was found to hold, and what is spent of it; a checkpoint keeps all of it."""

    steps: int
    """Planned length of the run, which its schedules have."""
    downscale: int
    """Factor by which photos are smaller in the whole run, at least."""
    most: int
    """Steps beyond which the run does not go on."""
    spent: float = 0.0
    """Seconds of this run, earlier processes included."""
    reached: float = 0.0
    """Position in the schedules, in planned steps."""

    def after_step(self, step: int, now: float, budget: float, is_first: bool) -> bool:
        """Go on after a step of the run by as large a share of what is ahead as it used of the time
        that was left: so the schedules end when the time does. Where the number of steps ends the
        run, not the time, they end with it.

        Args:
            now, budget: seconds of the run, until now and in all.
            is_first: of this process, in which photos are read and kernels loaded: it counts as one
                planned step however long it took.

        Returns:
            Whether the run is over.
        """
        end, ahead = budget - END_SECONDS, self.steps - self.reached
        moved = 1.0 if is_first else ahead * min(1.0, (now - self.spent) / (end - self.spent))
        self.reached += min(ahead, max(moved, ahead / max(1, self.most - step)))
        self.spent = now
        return now >= end or step + 1 >= self.most


def plan_budget(
    budget: float, spent: float, timed: Sequence[float], downscale: int, most: int
) -> BudgetPlan:
    """How many steps fit into a budget, and with photos of which size.

    Args:
        budget, spent: seconds, in all and until now.
        timed: mean seconds of a step, with photos reduced by `downscale` and by twice that.
        downscale: the least reduction of photos.
        most: steps, at most.

    Raises:
        ConfigError: fewer than `FEWEST_STEPS` fit, and more are wanted.
    """
    left, a_step = budget - spent - END_SECONDS, timed[0]
    if left / a_step < min(STEPS_WANTED, most):
        a_step, downscale = timed[1], 2 * downscale
    steps, fewest = min(most, int(left / a_step)), min(FEWEST_STEPS, most)
    if steps < fewest:
        needed = spent + END_SECONDS + 1.2 * fewest * a_step
        raise ConfigError(
            f"--budget is {budget:.0f} s, of which {spent:.0f} s are spent: {max(0, steps)} steps "
            f"fit, and a run needs {fewest}. Give {needed:.0f}s or more, or smaller photos (the "
            "data parser's --downscale-factor)."
        )
    return BudgetPlan(steps, downscale, most)


def saved_plan(path: Path, state: Mapping[str, Any], budget: float, spent: float) -> BudgetPlan:
    """The plan in the checkpoint that a run goes on from; `budget` and `spent` are seconds, in all
    and of this process. Raises ConfigError where that run had no budget, or nothing is left of it.
    """
    if "budget" not in state:
        raise ConfigError(
            f"The run of {path} had no --budget: give --max-num-iterations, the total of steps."
        )
    plan = BudgetPlan(**{each.name: state["budget"][each.name] for each in fields(BudgetPlan)})
    spent, reached = plan.spent + spent, round(plan.reached)
    if reached >= plan.steps or spent + END_SECONDS >= budget:
        raise ConfigError(
            f"There is nothing left to train: {spent:.0f} of {budget:.0f} s are spent, and "
            f"{reached} of {plan.steps} planned steps are done. A run that was stopped goes on "
            "with a larger --budget, the total."
        )
    return plan


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
