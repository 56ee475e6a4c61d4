import pytest
import torch
from pytorch_msssim import ssim as msssim_ssim

from desplat_ns.backend import ssim as ssim_module
from desplat_ns.losses import photometric_losses

SIZES = [(11, 11), (11, 40), (26, 27), (37, 171)]
"""The smallest image, one row of windows, and sizes around those of a block (16 x 160 pixels)."""

FLAT = 1e-5
"""SSIM of float32 images of contrast 0.05 and more: variances are differences of numbers near 1
with rounding errors of about 11 * 2^-24, over 0.05^2; the mean of many is off by less."""


def images(height: int, width: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """A smooth image with noise, and itself with more noise."""
    rng = torch.Generator().manual_seed(seed)
    noise = torch.rand(height, width, 3, generator=rng)
    wave = torch.sin(torch.arange(height)[:, None, None] / 5) * torch.linspace(0, 1, width)[:, None]
    target = (0.3 * noise + 0.3 + 0.3 * wave).clamp(0, 1)
    return (target + 0.1 * torch.randn(target.shape, generator=rng)).clamp(0, 1), target


def ssim(pred: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    return 1 - photometric_losses(target, None, 1.0, pred)[0]


def exact(pred: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """pytorch_msssim in float64, whose window itself is rounded to float32."""
    planes = (image.double().movedim(-1, 0)[None] for image in (pred, target))
    return msssim_ssim(*planes, data_range=1.0)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("device", ["cpu", "gpu"])
def test_value_and_gradient_agree_with_pytorch_msssim_in_float64(size, device, monkeypatch):
    """By the CPU's kernel, and by what a GPU does without fused-ssim, run on the CPU."""
    if device == "gpu":
        monkeypatch.setattr(torch.Tensor, "is_cpu", False)
    pred, target = images(*size)
    leaf, double = pred.clone().requires_grad_(), pred.double().requires_grad_()
    got, want = ssim(leaf, target), exact(double, target)
    assert got.item() == pytest.approx(want.item(), abs=FLAT)
    (3 * got).backward()
    (3 * want).backward()
    assert leaf.grad is not None and double.grad is not None
    # A gradient divides by a variance once more than the value does.
    error = (leaf.grad - double.grad).abs().max()
    assert error <= 10 * FLAT * double.grad.abs().max()


def test_strided_images_give_the_same():
    pred, target = images(21, 34)
    strided = pred.movedim(-1, 0).contiguous().movedim(0, -1)
    assert not strided.is_contiguous()
    assert torch.equal(ssim(strided, target), ssim(pred, target))


@pytest.mark.filterwarnings("ignore:Skipping Gaussian Smoothing")
@pytest.mark.parametrize("kind", ["float64", "small"])
def test_what_the_kernels_cannot_do_torch_does(kind):
    pred, target = images(10, 30) if kind == "small" else images(16, 16)
    if kind == "float64":
        pred, target = pred.double(), target.double()
    assert ssim(pred, target).item() == pytest.approx(exact(pred, target).item(), abs=FLAT)


def test_fused_ssim_is_taken_where_it_is_installed_for_both_images_of_a_step(monkeypatch):
    """With a stand-in that has its arguments, of planes and their borders left out."""
    calls = []

    def fused(image: torch.Tensor, target: torch.Tensor, padding: str) -> torch.Tensor:
        calls.append((image.is_contiguous(), target.is_contiguous(), padding))
        return msssim_ssim(image, target, data_range=1.0)

    (one, other), photo = images(16, 20), images(16, 20, seed=1)[0]
    weight = (torch.arange(16 * 20).reshape(16, 20, 1) % 3 / 2).float()
    wanted = photometric_losses(photo, weight, 0.2, one, other)
    monkeypatch.setattr(torch.Tensor, "is_cpu", False)
    plain = photometric_losses(photo, weight, 0.2, one, other)
    monkeypatch.setattr(torch.Tensor, "is_cuda", True)
    monkeypatch.setattr(ssim_module, "fused_ssim", fused)
    for got in (plain, photometric_losses(photo, weight, 0.2, one, other)):
        torch.testing.assert_close(torch.stack(got), torch.stack(wanted), atol=FLAT, rtol=0)
    assert calls == [(True, True, "valid")] * 2
