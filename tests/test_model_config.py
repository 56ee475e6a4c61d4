"""Every number of steps shrinks with the length of the run."""

from dataclasses import replace

import pytest

from desplat_ns.distractors import DistractorConfig
from desplat_ns.effects import EffectsConfig
from desplat_ns.model_config import DeSplatModelConfig


def test_every_step_number_shrinks_with_the_schedule():
    config = DeSplatModelConfig(
        schedule_scale=0.1, distractors=DistractorConfig(static_warmup=5000)
    ).scaled()
    assert config.warmup_length == 50
    assert config.refine_every == 10
    assert config.resolution_schedule == 300
    assert config.sh_degree_interval == 100
    assert config.stop_screen_size_at == 400
    assert config.stop_split_at == 1500
    assert config.distractors.stop_densify_at == 1500
    assert config.distractors.static_warmup == 500
    assert config.distractors.refine_every_visits == 5


def test_in_a_very_short_run_refinements_keep_their_distance_and_resets_their_share():
    config = DeSplatModelConfig(schedule_scale=0.02).scaled()
    assert config.refine_every == 10
    # 3,000 of 30,000 steps between resets; here 60 of 600.
    assert config.reset_alpha_every * config.refine_every == 60
    assert DeSplatModelConfig(refine_every=5).scaled().refine_every == 5


@pytest.mark.parametrize("steps", [60, 100, 250, 1000, 3000, 30000])
def test_a_run_of_any_length_refines_between_two_resets(steps):
    config = DeSplatModelConfig(schedule_scale=steps / 30000).scaled()
    reset = config.reset_alpha_every * config.refine_every
    pause = config.pause_after_reset(num_views=40)
    refinements = [step for step in range(0, reset, config.refine_every) if step >= pause]
    assert len(refinements) >= 2
    if steps == 30000:
        assert (reset, pause) == (3000, 140)


def test_after_the_warm_up_photos_have_half_their_size_at_least():
    config = DeSplatModelConfig(distractors=DistractorConfig(static_warmup=6000))
    long = config.for_views(40)
    assert long.distractors.static_warmup == 600
    assert (long.num_downscales, long.resolution_schedule) == (1, 6000)
    for scale in (1 / 30, 0.1):  # full size at the warm-up's end, as it is
        short = replace(config, schedule_scale=scale).scaled()
        assert (short.for_views(40).num_downscales, short.for_views(40).resolution_schedule) == (
            2,
            short.resolution_schedule,
        )


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
    of_views = config.for_views(40)
    assert of_views.num_downscales == config.num_downscales
    assert of_views.resolution_schedule == 3000
