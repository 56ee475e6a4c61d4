"""What a run of a length, on a number of views, makes of the settings."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
import torch

from desplat_ns.distractors.config import WARMUP_VISITS, DistractorConfig
from desplat_ns.model_config import DeSplatModelConfig
from tests.helpers.small_model import HEIGHT, WIDTH, camera, make_model

SEPARATING = DistractorConfig(static_warmup=None, refine_visits=5, start="residual")


def run_of(steps: int, views: int, **options: Any) -> DeSplatModelConfig:
    """The settings of a run of so many steps on so many views."""
    options.setdefault("refinements", 15)
    whole = DeSplatModelConfig(schedule_scale=min(1.0, steps / 30000), **options)
    return whole.for_run(views)


@pytest.mark.parametrize("steps", [1000, 3000, 30_000])
@pytest.mark.parametrize("views", [8, 40, 1000])
def test_visits_are_counted_in_steps_of_the_run_whatever_its_length(steps, views):
    """Nominal steps times the scale of the run, but for a rounding."""
    run, scale = run_of(steps, views, distractors=SEPARATING), steps / 30_000
    assert run.refine_every >= views // 2
    assert run.distractors.warmup * scale <= WARMUP_VISITS[1] * views + 1
    every = run.distractors.steps_between_refinements(views, scale)
    assert every * scale >= SEPARATING.refine_visits * views - 1
    intervals = {run_of(steps, views, refine_every=n).reset_every for n in (10, 1000)}
    assert intervals == {3000}, "resets keep their place whatever the interval"


def test_memory_is_a_ceiling_whatever_the_capture_could_hold(monkeypatch):
    """2,000 photos of 1600 x 1200 could hold 192 million; 16 GB have room for a few."""
    memory = SimpleNamespace(total=16 * 10**9, available=0)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: memory)
    config = DeSplatModelConfig(gaussians_per_pixel=0.05)
    assert config.most_gaussians(40 * 135 * 240, "cpu") == 64_800
    most = config.most_gaussians(2000 * 1600 * 1200, "cpu")
    parameters_and_moments = 3 * 59 * 4  # bytes: no run can do with fewer
    assert most * parameters_and_moments < memory.total / 2
    assert 10**6 < most < 10**7
    memory.total *= 2
    assert config.most_gaussians(10**12, "cpu") == pytest.approx(2 * most, abs=1)


@pytest.mark.parametrize("factor", [4, 2, 1])
def test_photos_keep_splatfactos_sizes(factor):
    config = DeSplatModelConfig(num_downscales=2)
    step = {4: 2999, 2: 5999, 1: 6000}[factor]
    assert config.downscale_factor(step, 800_000) == factor
    assert replace(config, num_downscales=0).downscale_factor(step, 800_000) == 1


@pytest.mark.parametrize(("pixels", "factor"), [(200_000, 1), (400_000, 8**0.5), (3_200_000, 8)])
def test_photos_start_smaller_the_larger_they_are(pixels, factor):
    config = DeSplatModelConfig(first_megapixels=0.05)
    assert config.downscale_factor(0, pixels) == pytest.approx(factor)


def test_a_step_draws_a_photo_in_its_size():
    model = make_model(first_megapixels=30 / 1e6, num_downscales=1, resolution_schedule=1000)
    photo = torch.arange(WIDTH)[None, :, None].repeat(HEIGHT, 1, 3).to(torch.uint8)
    for step in (0, 500, 1000):
        model.step, model.optimizers = step, {}
        outputs = model.get_outputs(camera(train_idx=1))
        shown = model.get_gt_img(photo)
        assert outputs["rgb"].shape == shown.shape
        means = shown.mean(dim=(0, 2)) * 255  # of areas, in 8 bits
        columns = torch.linspace(0, WIDTH, len(means) + 1)
        assert torch.allclose(means, (columns[1:] + columns[:-1] - 1) / 2, atol=0.51)
    assert torch.equal(shown, photo.float() / 255)


def test_colours_of_what_is_transparent_do_not_bleed_into_smaller_photos():
    model = make_model(train_downscale=5)
    photo = torch.zeros(HEIGHT, WIDTH, 4, dtype=torch.uint8)
    photo[:, :, 1] = 255  # green, which nobody sees
    photo[:, :12] = torch.tensor([200, 0, 0, 255], dtype=torch.uint8)
    shown = model.get_gt_img(photo)
    assert shown.shape[1] == 5  # so that the edge lies within a pixel
    seen = shown[..., 3] > 0
    assert ((shown[..., 3] > 0.1) & (shown[..., 3] < 0.9)).any()
    assert torch.allclose(shown[seen][:, :3] * 255, torch.tensor([200.0, 0, 0]), atol=1)
