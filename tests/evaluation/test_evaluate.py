"""Averages that an evaluation reports."""

from __future__ import annotations

import json
import math

import pytest

from desplat_ns.evaluation.evaluate import ScoredImage, summarize


def _image(seconds: float = 1.0, **metrics: float) -> ScoredImage:
    return ScoredImage("a.png", 4, 3, metrics, seconds, 2 * seconds)


def test_means_and_standard_deviations_of_a_hand_worked_pair():
    pair = [_image(psnr=20.0, seconds=1.0), _image(psnr=24.0, seconds=3.0)]
    result = summarize(pair, True)
    assert result["psnr"] == 22.0
    assert result["psnr_std"] == pytest.approx(math.sqrt(8))  # (2^2 + 2^2) / (2 - 1)
    assert result["num_images"] == 2
    assert result["seconds_per_image_render"] == 2.0
    assert result["seconds_per_image_with_metrics"] == 4.0
    assert "psnr_std" not in summarize(pair[:1], True)
    assert "psnr_std" not in summarize(pair, False)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_figures_that_are_not_finite_never_reach_the_json(value: float):
    result = summarize([_image(psnr=value, ssim=0.5), _image(psnr=20.0, ssim=0.7)], True)
    assert "psnr" not in result
    assert result["ssim"] == pytest.approx(0.6)
    json.dumps(result, allow_nan=False)
