"""What a run is said to take, by what its steps draw."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from desplat_ns.core.schedule import RunStep, Schedule
from desplat_ns.training.clock import GAUSSIAN, LAYER, LOOK, Clock

SIZE, VIEWS, STEPS, START, WARMUP = 100_000, 40, 1_000, 5_000, 6_000
FIXED, PIXEL = 0.02, 1e-6


def a_run(
    downscale: Callable[..., float] = lambda *_: 1, distractors: Any = None, most=10**9
) -> Any:
    """What a clock asks of a pipeline: a run of `STEPS` steps that has done none."""
    config = SimpleNamespace(downscale_factor=downscale, stop_split_at=15_000)
    config.distractors = SimpleNamespace(warmup=WARMUP)
    model = SimpleNamespace(
        config=config, schedule=Schedule(STEPS / 30_000), distractors=distractors
    )
    model.nominal_step, model.num_train_data = 0, VIEWS
    model.strategy = SimpleNamespace(most=most)
    model.gauss_params = {"means": range(START)}
    rays = SimpleNamespace(get_train_rays_per_batch=lambda: SIZE)
    return SimpleNamespace(model=model, datamanager=rays)


def halves(nominal: int, _: float) -> float:
    return 4 if nominal < 15_000 else 1


@pytest.mark.parametrize("added", [0, 15_000, 60_000, 120_000])
@pytest.mark.parametrize("slower", [1.0, 1.5])
def test_what_is_told_is_within_a_quarter_of_the_truth_once_growth_shows(added, slower):
    """Photos get larger on the way; the machine is slower than it was in the trial."""
    run = a_run(halves, object())
    clock, told, seconds = Clock(run, FIXED, PIXEL), dict[int, float](), list[float]()
    for step in range(STEPS):
        done = min(1.0, run.model.schedule.nominal(RunStep(step)) / 15_000)
        run.model.nominal_step = run.model.schedule.nominal(RunStep(step))
        run.model.gauss_params["means"] = range(round(START + done * added))
        drawn = SIZE / halves(run.model.nominal_step, SIZE) ** 2
        if run.model.nominal_step >= WARMUP:
            drawn += LAYER * drawn + LOOK * (step < 200 + VIEWS)
        drawn += GAUSSIAN * done * added
        seconds.append(slower * (FIXED + PIXEL * drawn))
        clock.after_step(step, seconds[-1])
        if step % 100 == 0 and step >= 300:
            told[step + 1] = clock.left(step + 1, STEPS)
    for step, left in told.items():
        assert left == pytest.approx(sum(seconds[step:]), rel=0.25)


def test_a_machine_that_gets_faster_is_noticed_within_minutes():
    run = a_run(most=START)
    clock = Clock(run, FIXED, PIXEL)
    at_once = clock.left(500, STEPS)
    for step in range(300):
        clock.after_step(step, 3 * (FIXED + PIXEL * SIZE))
    assert clock.left(500, STEPS) == pytest.approx(3 * at_once, rel=0.2)
    for step in range(300, 1_800):
        clock.after_step(step, FIXED + PIXEL * SIZE)
    assert clock.left(500, STEPS) == pytest.approx(at_once, rel=0.2)
