"""Metrics: hand-worked values, scikit-image as independent reference, LPIPS without weights."""

from __future__ import annotations

import json
import math
import socket
from typing import Any
from urllib.error import URLError

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torch import nn

from desplat_ns.rendering import metrics
from desplat_ns.rendering.metrics import (
    PSNR_MAX,
    LazyLpips,
    image_metrics,
    mask_iou,
    mean_alpha_outside,
    psnr,
    ssim,
)

SMALLEST = metrics._NETS["alex"].min_side


def _pair(seed: int = 0, height: int = 24, width: int = 31) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    truth = torch.rand((height, width, 3), generator=generator)
    noise = 0.1 * torch.randn((height, width, 3), generator=generator)
    return (truth + noise).clamp(0, 1), truth


# --- PSNR, SSIM ---------------------------------------------------------------------------------


def test_an_error_of_a_tenth_everywhere_is_20_db():
    truth = torch.full((2, 3, 3), 0.5, dtype=torch.float64)
    assert psnr(truth + 0.1, truth) == pytest.approx(20.0, abs=1e-9)  # -10 log10(0.01)


def test_one_wrong_pixel_of_four_costs_its_share():
    truth = torch.zeros((2, 2, 1))
    pred = truth.clone()
    pred[0, 0] = 1.0
    assert psnr(pred, truth) == pytest.approx(10 * math.log10(4), abs=1e-9)


def test_psnr_of_identical_images_is_a_number_that_json_can_hold():
    image, _ = _pair()
    assert psnr(image, image) == PSNR_MAX
    assert json.loads(json.dumps(psnr(image, image), allow_nan=False)) == PSNR_MAX


def test_psnr_does_not_hide_values_that_are_not_numbers():
    _, truth = _pair()
    pred = truth.clone()
    pred[0, 0, 0] = math.nan
    assert math.isnan(psnr(pred, truth))


@pytest.mark.parametrize("seed", range(3))
def test_psnr_agrees_with_scikit_image(seed: int):
    pred, truth = _pair(seed)
    theirs = peak_signal_noise_ratio(truth.double().numpy(), pred.double().numpy(), data_range=1)
    assert psnr(pred, truth) == pytest.approx(theirs, rel=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_ssim_agrees_with_scikit_image(seed: int):
    """Same window (11 x 11, sigma 1.5) and constants; the mean over whole windows only."""
    pred, truth = _pair(seed, 40, 33)
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


def test_ssim_of_identical_images_is_1():
    image, _ = _pair()
    assert ssim(image, image) == pytest.approx(1.0, abs=1e-6)


@given(gain=st.floats(1.01, 3.0))
def test_more_of_the_same_error_never_raises_psnr(gain: float):
    pred, truth = _pair(1)
    assert psnr(truth + gain * (pred - truth), truth) < psnr(pred, truth)


def test_a_wrong_shape_is_rejected():
    pred, truth = _pair()
    with pytest.raises(Exception, match=r"shape|Tensor"):
        ssim(pred[None], truth)


# --- masks --------------------------------------------------------------------------------------


def test_mask_iou_of_a_hand_worked_pair_is_one_third():
    pred = torch.tensor([True, True, False, False])
    truth = torch.tensor([False, True, True, False])
    assert mask_iou(pred, truth) == pytest.approx(1 / 3)


def test_two_empty_masks_agree():
    empty = torch.zeros(4, dtype=torch.bool)
    assert mask_iou(empty, empty) == 1.0


def test_an_empty_mask_misses_everything():
    empty, full = torch.zeros(4, dtype=torch.bool), torch.ones(4, dtype=torch.bool)
    assert mask_iou(empty, full) == 0.0


@given(
    pixels=st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=30),
)
def test_mask_iou_is_symmetric_and_equals_pythons_set_arithmetic(pixels: list[tuple[bool, bool]]):
    pred, truth = (torch.tensor([p[k] for p in pixels]) for k in (0, 1))
    a, b = ({i for i, p in enumerate(pixels) if p[k]} for k in (0, 1))
    expected = len(a & b) / len(a | b) if a | b else 1.0
    assert mask_iou(pred, truth) == mask_iou(truth, pred) == pytest.approx(expected)


def test_mean_alpha_outside_counts_only_pixels_off_the_mask():
    alpha = torch.tensor([[[0.9], [0.2]], [[0.0], [0.4]]])
    mask = torch.tensor([[[True], [False]], [[False], [False]]])
    assert mean_alpha_outside(alpha, mask) == pytest.approx((0.2 + 0.0 + 0.4) / 3)


def test_a_mask_over_everything_leaves_nothing_outside():
    assert mean_alpha_outside(torch.ones(3), torch.ones(3, dtype=torch.bool)) is None


# --- LPIPS --------------------------------------------------------------------------------------


class _Offline:
    calls = 0

    def __init__(self, *args: object, **kwargs: object) -> None:
        type(self).calls += 1
        raise URLError("no network")


class _Distance(nn.Module):
    """Stands in for torchmetrics' metric; says what it was built with."""

    built: tuple[object, ...] = ()
    resets = 0
    timeout: float | None = None

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__()
        type(self).built = (*args, kwargs)
        type(self).timeout = socket.getdefaulttimeout()

    def forward(self, truth: torch.Tensor, pred: torch.Tensor) -> torch.Tensor:
        return (truth - pred).abs().mean()

    def reset(self) -> None:
        type(self).resets += 1


@pytest.fixture
def offline(monkeypatch: pytest.MonkeyPatch) -> type[_Offline]:
    monkeypatch.setattr(_Offline, "calls", 0)
    monkeypatch.setattr("torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity", _Offline)
    return _Offline


@pytest.fixture
def online(monkeypatch: pytest.MonkeyPatch) -> type[_Distance]:
    monkeypatch.setattr(_Distance, "resets", 0)
    monkeypatch.setattr("torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity", _Distance)
    return _Distance


def _planes(side: int = 64) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.zeros((1, 3, side, side)), torch.full((1, 3, side, side), 0.25)


def test_without_weights_lpips_is_none_and_says_why_once(
    offline: type[_Offline], capsys: pytest.CaptureFixture[str]
):
    lpips = LazyLpips()
    assert lpips.reason is None
    assert [lpips(*_planes()) for _ in range(3)] == [None, None, None]
    assert offline.calls == 1
    assert lpips.reason is not None
    assert "no network" in lpips.reason
    assert capsys.readouterr().out.count("LPIPS is left out") == 1


def test_brackets_in_what_lpips_says_are_no_markup(capsys: pytest.CaptureFixture[str]):
    LazyLpips()._give_up("no file [/cache]/[alex].pth")
    assert "[/cache]/[alex].pth" in capsys.readouterr().out


def test_metrics_without_weights_have_no_lpips_key(offline: type[_Offline]):
    pred, truth = _pair(0, 40, 40)
    assert set(image_metrics(pred, truth, LazyLpips())) == {"psnr", "ssim"}
    assert offline.calls == 1


def test_lpips_is_built_when_first_called_as_splatfacto_builds_it(online: type[_Distance]):
    lpips = LazyLpips()
    online.built = ()
    distance = lpips(*_planes())
    assert distance is not None
    assert float(distance) == pytest.approx(0.25)
    assert online.built == ("alex", {"normalize": True})
    assert online.resets == 1


def test_fetching_weights_times_out_and_leaves_the_process_setting_alone(online: type[_Distance]):
    before = socket.getdefaulttimeout()
    LazyLpips()(*_planes())
    assert online.timeout == metrics.DOWNLOAD_TIMEOUT
    assert socket.getdefaulttimeout() == before


def test_images_too_small_for_alexnet_get_no_lpips(
    online: type[_Distance], capsys: pytest.CaptureFixture[str]
):
    lpips = LazyLpips()
    assert lpips(*_planes(SMALLEST - 1)) is None
    assert lpips.reason is not None
    assert str(SMALLEST) in lpips.reason


def test_the_smallest_side_is_alexnets():
    """Run through the layers that LPIPS taps, with random weights."""
    from torchvision.models import alexnet

    features = alexnet(weights=None).features[:12]
    with torch.no_grad():
        side = SMALLEST
        assert features(torch.zeros((1, 3, side, side))).numel() > 0
        with pytest.raises(RuntimeError):
            features(torch.zeros((1, 3, side - 1, side - 1)))


def test_the_smallest_side_of_vgg_is_16_pixels():
    """As above, up to the last layer that LPIPS taps."""
    from torchvision.models import vgg16

    features: Any = vgg16(weights=None).features
    features, side = features[:30], metrics._NETS["vgg"].min_side
    with torch.no_grad():
        assert features(torch.zeros((1, 3, side, side))).numel() > 0
        with pytest.raises(RuntimeError):
            features(torch.zeros((1, 3, side - 1, side - 1)))


def test_another_network_is_built_when_it_is_asked_for(online: type[_Distance]):
    lpips = LazyLpips()
    lpips(*_planes(20))
    assert lpips.reason is not None
    lpips.use("vgg")
    assert lpips(*_planes(20)) is not None and online.built == ("vgg", {"normalize": True})
    built = lpips._metric
    lpips.use("vgg")
    assert lpips._metric is built


@pytest.mark.parametrize(("net", "file"), [("alex", "alexnet-owt"), ("vgg", "vgg16")])
def test_where_weights_belong_is_said_by_the_networks_file(
    offline, tmp_path, monkeypatch, net, file
):
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    lpips = LazyLpips()
    lpips.use(net)
    assert lpips(*_planes()) is None
    path = metrics.lpips_weights(net)
    assert path.parent == tmp_path / "hub" / "checkpoints" and path.name.startswith(file)
    assert lpips.reason is not None and str(path) in lpips.reason


def test_lpips_adds_nothing_to_a_checkpoint(online: type[_Distance]):
    model: Any = nn.Module()
    model.lpips = LazyLpips()
    model.lpips(*_planes())
    assert not model.state_dict()


def test_what_is_scored_is_what_would_be_saved():
    _, truth = _pair()
    white = torch.ones_like(truth)
    assert image_metrics(7 * white, white) == image_metrics(white, white)
