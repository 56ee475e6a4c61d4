"""Averages, sizes and names that an evaluation reports."""

from __future__ import annotations

import json
import math

import pytest
import torch
from torch import nn

import desplat_ns
from desplat_ns.evaluation.records import (
    PACKAGES,
    ScoredImage,
    gaussian_counts,
    memory_mb,
    per_image,
    summarize,
    versions,
)


def _image(name: str = "a.png", seconds: float = 1.0, **metrics: float) -> ScoredImage:
    return ScoredImage(name, 4, 3, metrics, seconds, 2 * seconds)


def test_means_and_standard_deviations_of_a_hand_worked_pair():
    result = summarize([_image(psnr=20.0, seconds=1.0), _image(psnr=24.0, seconds=3.0)], True)
    assert result["psnr"] == 22.0
    assert result["psnr_std"] == pytest.approx(math.sqrt(8))  # (2^2 + 2^2) / (2 - 1)
    assert result["num_images"] == 2
    assert result["seconds_per_image_render"] == 2.0
    assert result["seconds_per_image_with_metrics"] == 4.0


def test_one_image_has_no_standard_deviation():
    result = summarize([_image(psnr=20.0)], True)
    assert "psnr_std" not in result
    json.dumps(result, allow_nan=False)


def test_standard_deviations_are_left_out_unless_asked_for():
    assert "psnr_std" not in summarize([_image(psnr=20.0), _image(psnr=21.0)], False)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_figures_that_are_not_finite_never_reach_the_json(value: float):
    images = [_image(psnr=value, ssim=0.5), _image(psnr=20.0, ssim=0.7)]
    result = summarize(images, True)
    assert "psnr" not in result
    assert result["ssim"] == pytest.approx(0.6)
    json.dumps([result, per_image(images)], allow_nan=False)


def test_each_image_is_listed_with_name_size_and_metrics():
    assert per_image([_image("x.png", psnr=20.0)]) == [
        {"name": "x.png", "width": 4, "height": 3, "psnr": 20.0}
    ]


def test_memory_is_4_bytes_a_float_in_units_of_a_million():
    params = nn.ParameterDict({"means": torch.zeros(1000, 3), "opacities": torch.zeros(1000, 1)})
    assert memory_mb(params.values()) == pytest.approx(0.016)
    assert memory_mb(()) == 0.0


def test_without_distractors_their_count_and_memory_are_0():
    params = nn.ParameterDict({"means": torch.zeros(250, 3)})
    assert gaussian_counts(params, None) == {
        "num_static_gaussians": 250,
        "num_distractor_gaussians": 0,
        "static_memory_mb": pytest.approx(0.003),
        "distractor_memory_mb": 0.0,
    }


def test_versions_name_every_package():
    record = versions()
    assert record["desplat_ns"] == desplat_ns.__version__
    assert record["torch"] in (torch.__version__, torch.__version__.split("+")[0])
    assert {*PACKAGES, "python"} <= record.keys()
