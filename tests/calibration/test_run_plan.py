"""What fits into a budget, and how large the photos are."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.calibration import run_plan
from desplat_ns.calibration.run_plan import (
    FEWEST_STEPS,
    MOST_GAUSSIANS,
    MOST_GROWTH,
    MOST_PIXELS,
    STEPS_WANTED,
    StepCost,
    expected_gaussians,
    measure_costs,
    measure_step,
    plan_run,
)
from desplat_ns.calibration.timing import Timing
from desplat_ns.datamanager import training_split
from desplat_ns.errors import ConfigError
from desplat_ns.gaussians.room import most_in_memory
from desplat_ns.model import DeSplatModelConfig
from desplat_ns.settings.effects import EffectsConfig
from desplat_ns.training.budget import END_SECONDS, StepSeconds

EVEN = StepCost(StepSeconds(fixed=0.1, whole_photo=0.0), share_at_start=1.0)
MODEL = DeSplatModelConfig(effects=EffectsConfig(distractors=False), num_downscales=0)


def photos_of(views: int, width: int, height: int, points: int = 0) -> DataparserOutputs:
    cameras = Cameras(
        torch.eye(4)[:3].repeat(views, 1, 1), 1e3, 1e3, width / 2, height / 2, width, height
    )
    metadata = {"points3D_xyz": torch.zeros(points, 3)} if points else {}
    return DataparserOutputs([], cameras, metadata=metadata)


def plan(budget: float, cost: StepCost = EVEN, model: DeSplatModelConfig = MODEL, spent=0.0):
    return plan_run(budget, spent, model, 10, (30_000, 30_000), cost)


def test_steps_are_what_the_time_left_holds():
    planned = plan(budget=210 + END_SECONDS, spent=10.0)
    assert planned.steps == pytest.approx(2000, abs=1)
    assert (planned.downscale, planned.spent) == (1, 0.0)


def test_no_more_steps_are_planned_than_are_wanted():
    assert plan(budget=1e6).steps == 30_000


def test_photos_shrink_where_too_few_steps_would_fit():
    by_pixels = StepCost(StepSeconds(fixed=0.0, whole_photo=0.2), share_at_start=1.0)
    full = plan(0.2 * STEPS_WANTED * 1.1 + END_SECONDS, by_pixels)
    half = plan(0.2 * STEPS_WANTED * 0.5 + END_SECONDS, by_pixels)
    assert full.downscale == 1
    assert half.downscale == 2
    assert half.steps == pytest.approx(4 * 0.5 * STEPS_WANTED, abs=1)


def test_a_budget_that_holds_no_run_is_refused_with_one_that_does():
    with pytest.raises(ConfigError, match=r"Give (\d+)s or more") as refused:
        plan(0.1 * FEWEST_STEPS * 0.9)
    enough = float(str(refused.value).split("Give ")[1].split("s or")[0])
    assert plan(enough).steps >= FEWEST_STEPS


def test_a_run_of_few_steps_is_planned_where_few_are_asked_for():
    assert FEWEST_STEPS > 20
    assert plan_run(1e3, 0.0, MODEL, 40, (20, 30_000), EVEN).steps == 20


def test_steps_are_cheaper_while_photos_and_the_set_are_small():
    cost = StepCost(StepSeconds(fixed=0.04, whole_photo=0.16), share_at_start=0.25)
    model = replace(MODEL, num_downscales=1)
    run = model.for_run(10)
    assert cost.at(run, 0) == pytest.approx(0.01 + 0.16 / 4)
    assert cost.at(run, 29_970) == pytest.approx(0.2)
    assert 0.15 < cost.mean(model, 10, 30_000) < 0.2


def test_a_run_without_a_limit_is_expected_to_grow_as_much_as_one_with_desplats():
    limited, outputs = replace(MODEL, gaussians_per_pixel=0.01), photos_of(1, 200, 200)
    assert expected_gaussians(outputs, MODEL, "cpu") == 2_000
    assert expected_gaussians(outputs, limited, "cpu") == 400


def test_the_forecast_of_a_large_capture_follows_its_points_not_a_limit_nobody_reaches():
    """2,000 photos of 1600 x 1200: 192 million by their pixels."""
    desplat = replace(MODEL, gaussians_per_pixel=0.05)
    few, many = (photos_of(2000, 1600, 1200, points=count) for count in (10_000, 200_000))
    by_points = [expected_gaussians(outputs, desplat, "cpu") for outputs in (few, many)]
    assert by_points == [MOST_GROWTH * 10_000, MOST_GROWTH * 200_000]
    no_points = expected_gaussians(photos_of(2000, 1600, 1200), desplat, "cpu")
    assert no_points == most_in_memory("cpu") < 0.05 * 2000 * 1600 * 1200


def test_costs_of_a_capture_are_measured_on_steps_of_its_size(tiny_run, tmp_path):
    config = tiny_run(tmp_path)
    outputs = training_split(config.pipeline.datamanager)
    torch.manual_seed(7)
    expected = torch.rand(3)
    torch.manual_seed(7)
    cost = measure_costs(outputs, config.pipeline.model, "cpu")
    assert torch.equal(torch.rand(3), expected)  # the seed of a run stays that of the run
    assert cost.seconds.fixed >= 0 and cost.seconds.whole_photo >= 0
    assert 1e-4 < cost.seconds.fixed + cost.seconds.whole_photo < 10
    assert 0 < cost.share_at_start <= 1


PER_GAUSSIAN, PER_PIXEL = 1e-6, 1e-7
"""Seconds of a step of the machine that is made up."""


def test_what_is_too_large_to_measure_costs_as_its_gaussians_and_pixels_say(
    monkeypatch: pytest.MonkeyPatch,
):
    """On a machine whose steps take so long for each Gaussian and each pixel, and no more."""
    width, height, views = 2000, 1500, 20
    sizes = []

    def step(scene: tuple[int, int, int], *_) -> tuple[int, int, int]:
        sizes.append(scene)
        return scene

    def timed(steps: dict[str, tuple[int, int, int]], _) -> dict[str, Timing]:
        seconds = {n: PER_GAUSSIAN * c + PER_PIXEL * w * h for n, (c, w, h) in steps.items()}
        return {name: Timing(wall=[1e3 * value]) for name, value in seconds.items()}

    monkeypatch.setattr(run_plan, "make_scene", lambda *size: size)
    monkeypatch.setattr(run_plan, "ModelStep", step)
    monkeypatch.setattr(run_plan, "time_in_turns", timed)
    outputs = photos_of(views, width, height)
    cost = measure_step(outputs, MODEL, "cpu")
    count, wide, high = max(sizes)
    assert count == MOST_GAUSSIANS and wide * high <= MOST_PIXELS
    expected = expected_gaussians(outputs, MODEL, "cpu")
    assert expected > 2 * MOST_GAUSSIANS
    assert cost.fixed == pytest.approx(PER_GAUSSIAN * expected)
    half_a_pixel = 0.5 / wide + 0.5 / high  # sides are rounded
    assert cost.whole_photo == pytest.approx(PER_PIXEL * width * height, rel=half_a_pixel)
