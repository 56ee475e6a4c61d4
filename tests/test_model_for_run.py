"""What a run of a length, on a number of views, makes of the settings."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.strategy import UNLIMITED
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.settings.effects import EffectsConfig

SEPARATING = DistractorConfig(static_warmup=6000, refine_visits=5, start="residual")


def run_of(steps: int, views: int, **options: Any) -> DeSplatModelConfig:
    """The settings of a run of so many steps on so many views."""
    options.setdefault("refinements", 15)
    whole = DeSplatModelConfig(schedule_scale=min(1.0, steps / 30000), **options)
    return whole.for_run(views)


@pytest.mark.parametrize(
    ("steps", "views", "every"),
    [
        (1000, 8, 34),  # a fifteenth of 500
        (1000, 100, 50),  # half a round
        (30000, 3000, 1500),
        (60000, 40, 1000),
    ],
)
def test_a_refinement_has_half_a_round_and_a_fifteenth_of_the_time(steps, views, every):
    assert run_of(steps, views).refine_every == every


@pytest.mark.parametrize("every", [10, 1000])
def test_resets_keep_their_place_whatever_the_interval(every):
    for steps in (1000, 3000, 30000, 60000):
        assert run_of(steps, 40, refine_every=every).reset_every == 3000
    assert run_of(3000, 40, reset_alpha_every=0).reset_every == UNLIMITED


def test_memory_is_a_ceiling_whatever_the_capture_could_hold(monkeypatch):
    """2,000 photos of 1600 x 1200 could hold 192 million; 16 GB have room for a few."""
    memory = SimpleNamespace(total=16 * 10**9)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: memory)
    config = DeSplatModelConfig(gaussians_per_pixel=0.05)
    assert config.most_gaussians(40 * 135 * 240, "cpu") == 64_800
    most = config.most_gaussians(2000 * 1600 * 1200, "cpu")
    parameters_and_moments = 3 * 59 * 4  # bytes: no run can do with fewer
    assert most * parameters_and_moments < memory.total / 2
    assert 10**6 < most < 10**7
    memory.total *= 2
    assert config.most_gaussians(10**12, "cpu") == pytest.approx(2 * most, abs=1)


@pytest.mark.parametrize(
    ("steps", "views", "options", "every"),
    [
        (1000, 8, {"distractors": SEPARATING}, 47.5),  # eight refinements from step 120 to 500
        (3000, 40, {"distractors": SEPARATING}, 200),  # five visits
        (30000, 40, {"distractors": SEPARATING}, 1800),  # eight refinements in 14,400 steps
        (1000, 1, {"refine_every": 100}, 10),  # the paper's: ten visits of each view
        (30000, 3000, {"refine_every": 100}, 30_000),
    ],
)
def test_distractors_settle_between_refinements_and_their_number_is_bounded(
    steps, views, options, every
):
    distractors = run_of(steps, views, **options).distractors
    nominal = distractors.steps_between_refinements(views, steps / 30_000)
    assert nominal == every * 30_000 / steps


@pytest.mark.parametrize(
    ("steps", "views", "warmup"),
    [
        (3000, 12, 180),  # 15 visits of each
        (3000, 25, 300),  # 250 steps once it may be refined
        (3000, 40, 320),  # 8 visits of each
        (30000, 1000, 6000),
        (1000, 40, 200),  # a thirtieth of 6000
    ],
)
def test_the_warm_up_has_the_steps_that_a_scene_needs_and_15_visits_at_most(steps, views, warmup):
    distractors = run_of(steps, views, distractors=SEPARATING).distractors
    assert distractors.static_warmup * steps / 30_000 == warmup


def test_photos_have_half_their_size_by_the_middle_of_the_warm_up():
    config = run_of(30000, 40, distractors=SEPARATING)
    sizes = [config.downscale_factor(step) for step in range(7000)]
    assert [sizes.index(factor) for factor in (4, 2, 1)] == [0, 300, 6000]  # warm-up: 600


@pytest.mark.parametrize(
    "options",
    [
        {"distractors": DistractorConfig()},
        {"effects": EffectsConfig(distractors=False)},
        {"num_downscales": 0},
    ],
)
def test_without_a_warm_up_photos_keep_splatfactos_sizes(options):
    config = replace(
        DeSplatModelConfig(distractors=DistractorConfig(static_warmup=6000)), **options
    )
    config = config.for_run(40)
    sizes = [config.downscale_factor(step) for step in (0, 2999, 3000, 5999, 6000)]
    assert sizes == ([1] * 5 if config.num_downscales == 0 else [4, 4, 2, 2, 1])
