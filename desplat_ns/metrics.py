"""Figures that say how good a rendering or a distractor mask is. PSNR, SSIM and LPIPS are
Splatfacto's, so that they compare: data range 1, SSIM by pytorch_msssim (11 x 11 Gaussian window),
LPIPS by torchmetrics on AlexNet, or on VGG16 if that is asked for."""

import socket
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool, Float
from pytorch_msssim import ssim as msssim_ssim
from torch import Tensor

from desplat_ns.core.console import announce
from desplat_ns.core.options import LpipsNet

PSNR_MAX = 100.0
"""dB. Reported for identical images instead of infinity, which JSON cannot hold."""

_NETS: dict[LpipsNet, tuple[str, str, int]] = {
    "alex": ("AlexNet", "alexnet-owt-7be5be79.pth", 31),
    "vgg": ("VGG16", "vgg16-397923af.pth", 16),
}
"""Name, the file that torchvision fetches, and the least side of an image in pixels: on a shorter
one the last pooling that counts has nothing left to pool."""

DOWNLOAD_TIMEOUT = 20.0
"""Seconds of silence after which fetching LPIPS's weights is given up; torch.hub waits for ever."""


def psnr(pred: Float[Tensor, "*shape"], truth: Float[Tensor, "*shape"]) -> float:
    """Peak signal-to-noise ratio of values in [0, 1], dB: -10 log10(mean squared error), at most
    `PSNR_MAX`, which identical images get; NaN where either image holds NaN."""
    mse = torch.mean((pred.double() - truth.double()) ** 2)
    return float(torch.clamp(-10 * torch.log10(mse), max=PSNR_MAX))


def ssim(pred: Float[Tensor, "H W C"], truth: Float[Tensor, "H W C"]) -> float:
    """Mean structural similarity of images in [0, 1]; 1 where they are identical."""
    planes = (image.permute(2, 0, 1)[None] for image in (pred, truth))
    return float(msssim_ssim(*planes, data_range=1.0))


def mask_iou(pred: Bool[Tensor, "*shape"], truth: Bool[Tensor, "*shape"]) -> float:
    """Intersection over union of two masks, in [0, 1]; 1 where both are empty."""
    union = int((pred | truth).sum())
    return int((pred & truth).sum()) / union if union else 1.0


def mean_alpha_outside(
    alpha: Float[Tensor, "*shape"], mask: Bool[Tensor, "*shape"]
) -> float | None:
    """Mean opacity where the mask is False, in [0, 1], which distractors claim of the static scene:
    0 is best; None where the mask covers everything."""
    return None if bool(mask.all()) else float(alpha[~mask].mean())


def image_metrics(
    pred: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"], lpips: "LazyLpips | None" = None
) -> dict[str, float]:
    """`psnr`, `ssim` and, where its weights can be had, `lpips` of an image in [0, 1]. What is
    scored is what would be saved: `pred` is clamped to [0, 1] first."""
    pred = pred.clamp(0.0, 1.0)
    figures = {"psnr": psnr(pred, truth), "ssim": ssim(pred, truth)}
    planes = [image.permute(2, 0, 1)[None] for image in (truth, pred)]
    distance = lpips(*planes) if lpips is not None else None
    if distance is not None:
        figures["lpips"] = float(distance)
    return figures


def lpips_weights(net: LpipsNet = "alex") -> Path:
    """Where the weights of LPIPS's network are looked for, and put once they were fetched."""
    return Path(torch.hub.get_dir()) / "checkpoints" / _NETS[net][1]


class LazyLpips:
    """torchmetrics' `LearnedPerceptualImagePatchSimilarity(normalize=True)`, built when first
    called and no `nn.Module`: it never enters a checkpoint. Where its weights cannot be had, every
    call gives None, `reason` says why, and the console says so once."""

    def __init__(self, normalize: bool = True) -> None:
        self.normalize = normalize
        self.net: LpipsNet = "alex"
        self.reason: str | None = None
        """Why there is no LPIPS; None as long as nothing is in its way."""
        self._metric: Any = None

    def use(self, net: LpipsNet) -> None:
        """Take a network from now on; what was in the way of another one does not count."""
        if net != self.net:
            self.net, self.reason, self._metric = net, None, None

    def __call__(
        self, truth: Float[Tensor, "B 3 H W"], pred: Float[Tensor, "B 3 H W"]
    ) -> Float[Tensor, ""] | None:
        """Mean perceptual distance of images in [0, 1], 0 for equal ones; None without weights."""
        least = _NETS[self.net][2]
        if self.reason is None and min(truth.shape[-2:]) < least:
            self._give_up(f"images are smaller than the {least} pixels that it needs")
        if self.reason is None and self._metric is None:
            self._build(truth.device)
        if self._metric is None or self.reason is not None:
            return None
        distance = self._metric(truth, pred)
        self._metric.reset()  # or torchmetrics keeps every distance for a mean nobody asks for
        return distance

    def _build(self, device: torch.device) -> None:
        from torchmetrics.image.lpip import LearnedPerceptualImagePatchSimilarity  # takes long

        timeout = socket.getdefaulttimeout()
        socket.setdefaulttimeout(DOWNLOAD_TIMEOUT)
        try:
            metric = LearnedPerceptualImagePatchSimilarity(self.net, normalize=self.normalize)
            self._metric = metric.to(device)
        # A missing network shows as URLError, OSError, RuntimeError (bad hash) or others by proxy;
        # none of them is worth losing an evaluation.
        except Exception as error:
            self._give_up(
                f"{_NETS[self.net][0]}'s weights could not be had ({type(error).__name__}: "
                f"{error}). They are fetched once where there is a network; elsewhere copy the "
                f"file to {lpips_weights(self.net)}"
            )
        finally:
            socket.setdefaulttimeout(timeout)

    def _give_up(self, reason: str) -> None:
        self.reason = reason
        announce(f"LPIPS is left out: {reason}.", warning=True)
