"""How images are scored: the options of ns-eval and desplat-eval."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from desplat_ns.core.options import LpipsNet, ranged

FIGURES = {
    "psnr": "PSNR {:.2f} dB",
    "ssim": "SSIM {:.3f}",
    "lpips": "LPIPS {:.3f}",
    "mask_iou": "IoU of masks with true ones {:.2f}",
}

ProtocolName = Literal["auto", "half", "full", "right"]


def in_words(figures: Mapping[str, Any]) -> str:
    """Scores in a line, as far as they were measured."""
    return ", ".join(form.format(figures[key]) for key, form in FIGURES.items() if key in figures)


@dataclass
class EvaluationConfig:
    """How images are scored. Saved with the run, so that plain `ns-eval` follows it."""

    protocol: ProtocolName = "auto"
    """half: find the image's embedding on its left half, score its right half (B.1). full: score
    the whole image in the training images' average light. right: score the right half in that
    light, to compare a model without appearance with others on the same pixels. auto: half if
    images have a light of their own, else full."""
    steps: int = ranged(128, "[0, inf)")
    """Steps of Adam for an embedding. B.3. The numbers of `appearance camera` alone are found in
    closed form; there, steps and rate mean nothing."""
    learning_rate: float = ranged(0.01, "(0, inf)")
    """Of the embedding. B.3."""
    lpips_net: LpipsNet = "alex"
    """Network of LPIPS. alex (AlexNet): as nerfstudio, on which the paper builds; vgg (VGG16): as
    3DGS and what is built on it. Figures of one say nothing about those of the other."""
