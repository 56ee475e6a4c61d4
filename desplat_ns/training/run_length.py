"""Arithmetic of steps: how schedules and intervals depend on a run's length and the views.

A run shorter than the method's own goes through the same schedules, in nominal steps, in fewer of
its own; the schedule scale is their ratio. A longer one keeps scale 1.
"""

from __future__ import annotations

import math

from desplat_ns.errors import ConfigError

SPLATFACTOS_INTERVAL = 100
"""Steps. Splatfacto counts its resets in refinements of this many steps, and lets the scene recover
from one for as long (and a round of the views); ours do so whatever the interval."""


def schedule_scale(max_num_iterations: int, nominal: int) -> float:
    """Steps for each nominal step, in (0, 1], in a run of `max_num_iterations` steps.

    `nominal` is the method's own number of steps (B.3: 30,000; 200,000 for Photo Tourism).
    Raises ConfigError where either is below 1.
    """
    if max_num_iterations < 1 or nominal < 1:
        raise ConfigError(
            f"A run needs at least one step: --max-num-iterations is {max_num_iterations} and "
            f"--nominal-num-iterations is {nominal}. Give both a value of 1 or more."
        )
    return min(1.0, max_num_iterations / nominal)


COUNTED_VIEWS = 40
"""Fewer views count as so many: a run for them is as long, and a shorter one has higher rates. A
scene takes shape in steps, as one of Adam is as long as its rate, however often the views are drawn
meanwhile."""

GPU_VISITS = 2
"""A GPU shows photos so many times as often as a CPU, whose hours are dearer. Not measured
(docs/results/speed.md, "How long to train")."""


def steps_for_visits(visits: float, num_views: int, at_most: int) -> int:
    """Steps in which each of the views is drawn `visits` times, or more often where they are fewer
    than `COUNTED_VIEWS`; `at_most` of them."""
    return max(1, min(at_most, math.ceil(visits * max(num_views, COUNTED_VIEWS))))


MOST_RATE_FACTOR = 4.0
"""Rates are at most so many times as high as they are given: at 6 times nothing was better."""


def rate_factor(num_views: int, steps: int, full_visits: float) -> float:
    """Factor, 1 to `MOST_RATE_FACTOR`, on the learning rates of a run that sees photos seldom.

    Adam's steps are as long as the rate whatever the gradient, so that rates for a run of many
    visits leave a short one far from where it is heading; and rates for few visits fit each photo
    of a long one more closely than the views between them.

    Args:
        steps: of the run.
        full_visits: of each photo, for which the rates are meant; 0 for a factor of 1. As in
            `steps_for_visits`, fewer than `COUNTED_VIEWS` photos count as so many.
    """
    if full_visits <= 0:
        return 1.0
    full = full_visits * max(num_views, COUNTED_VIEWS)
    return min(MOST_RATE_FACTOR, max(1.0, full / steps))


def early_rate_factor(step: int, warmup: int, wanted: int) -> float:
    """Factor, 1 to `MOST_RATE_FACTOR`, on the learning rates at a step of a run whose warm-up ends
    before it has as many steps as a scene needs to take shape.

    Few photos have been seen often by then, and what is not learned yet is left out. So rates are
    as much higher as the warm-up is shorter, and fall until the step at which it would have ended.

    Args:
        warmup: steps of the warm-up.
        wanted: steps that it would have with more photos.
    """
    return min(MOST_RATE_FACTOR, max(1.0, wanted / max(step, warmup, 1)))


def steps_between_refinements(
    num_views: int, densification: int, refinements: int, at_most: int
) -> int:
    """Steps of the run from one refinement of the static set to the next.

    Between two refinements gradients are sampled, over half of the views at least: over fewer they
    are mostly noise.

    Args:
        densification: steps of the run until which there are refinements.
        refinements: how many there should be in that time.
        at_most: upper bound on the result; 0 for none.
    """
    every = max(num_views // 2, math.ceil(densification / refinements))
    return min(every, at_most) if at_most > 0 else every


def pause_after_reset(num_views: int, reset_every: int, scale: float) -> int:
    """Nominal steps after a reset in which the scene recovers: nothing is sampled for refinement.

    Splatfacto's rule, a round of the views and one of its intervals in steps of the run, but half
    the time to the next reset at most.

    Args:
        reset_every: nominal steps from one reset to the next.
        scale: steps of the run for each nominal one.
    """
    return min(round((num_views + SPLATFACTOS_INTERVAL) / scale), reset_every // 2)


def photo_downscale(step: int, num_downscales: int, every: int, warmup: int = 0) -> int:
    """Factor by which photos are reduced at a step: 2^num_downscales, halved every `every` steps.

    With distractors that have a warm-up, photos have at least half their size by the middle of
    it: in smaller photos occluders do not stand out enough to be found, and are learned.

    Args:
        warmup: steps in which the static scene trains alone.
    """
    if step >= num_downscales * every:
        return 1
    if warmup == 0 or num_downscales == 1:
        return 2 ** (num_downscales - step // every)
    early = max(1, min(every, warmup // (2 * (num_downscales - 1))))
    return 2 ** max(1, num_downscales - step // early)
