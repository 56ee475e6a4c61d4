"""Metrics: hand-worked values, scikit-image as independent reference, LPIPS without weights."""

import json
import math
from typing import Any
from urllib.error import URLError

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity
from torch import nn

from desplat_ns.metrics import PSNR_MAX, LazyLpips, image_metrics, psnr, ssim


def _pair(seed: int = 0, height: int = 24, width: int = 31) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    truth = torch.rand((height, width, 3), generator=generator)
    noise = 0.1 * torch.randn((height, width, 3), generator=generator)
    return (truth + noise).clamp(0, 1), truth


def test_an_error_of_a_tenth_everywhere_is_20_db():
    truth = torch.full((2, 3, 3), 0.5, dtype=torch.float64)
    assert psnr(truth + 0.1, truth) == pytest.approx(20.0, abs=1e-9)  # -10 log10(0.01)


def test_psnr_is_a_number_that_json_can_hold_unless_a_value_is_none():
    image, _ = _pair()
    assert json.loads(json.dumps(psnr(image, image), allow_nan=False)) == PSNR_MAX
    broken = image.clone()
    broken[0, 0, 0] = math.nan
    assert math.isnan(psnr(broken, image))


def test_ssim_agrees_with_scikit_image():
    """Same window (11 x 11, sigma 1.5) and constants; the mean over whole windows only."""
    pred, truth = _pair(0, 40, 33)
    ssim_map = structural_similarity(
        truth.double().numpy(),
        pred.double().numpy(),
        channel_axis=2,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=1,
        full=True,
    )[-1]
    theirs = np.mean(ssim_map[5:-5, 5:-5])
    # float32 variances of order 0.1, from differences of squares summed over 121 weights, over
    # denominators that are at least as large: about 121 roundings of 6e-8.
    assert ssim(pred, truth) == pytest.approx(theirs, abs=121 * 6e-8)


def _planes(side: int = 64) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.zeros((1, 3, side, side)), torch.full((1, 3, side, side), 0.25)


def test_without_weights_lpips_is_none_and_says_why_once(
    capsys: pytest.CaptureFixture[str], tmp_path, monkeypatch
):
    calls = []

    def offline(*args: object, **kwargs: object) -> None:
        calls.append(args)
        raise URLError("no network [/cache]/[alex].pth")

    monkeypatch.setattr("torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity", offline)
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    assert LazyLpips()(*_planes(20)) is None and not calls, "too small for AlexNet"
    lpips = LazyLpips()
    assert [lpips(*_planes()) for _ in range(3)] == [None, None, None]
    assert len(calls) == 1 and lpips.reason is not None
    said = capsys.readouterr().out
    assert "no network" in lpips.reason and str(tmp_path) in lpips.reason
    assert "[/cache]/[alex].pth" in said  # brackets are no markup


def test_lpips_is_built_when_first_called_and_no_checkpoint_holds_it(monkeypatch):
    built = []

    class Distance(nn.Module):
        """Stands in for torchmetrics' metric."""

        def __init__(self, *args: object, **kwargs: object) -> None:
            super().__init__()
            built.append((*args, kwargs))
            self.weights = nn.Parameter(torch.ones(1))

        def forward(self, truth: torch.Tensor, pred: torch.Tensor) -> torch.Tensor:
            return (truth - pred).abs().mean()

        def reset(self) -> None:
            pass

    monkeypatch.setattr("torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity", Distance)
    model: Any = nn.Module()
    model.lpips = LazyLpips()
    distance = model.lpips(*_planes())
    assert distance is not None and distance.item() == pytest.approx(0.25)
    assert not model.state_dict() and not list(model.parameters())
    model.lpips.use("vgg")
    model.lpips(*_planes())
    assert built == [(net, {"normalize": True}) for net in ("alex", "vgg")]  # as by splatfacto


def test_what_is_scored_is_what_would_be_saved():
    _, truth = _pair()
    white = torch.ones_like(truth)
    assert image_metrics(7 * white, white) == image_metrics(white, white)
