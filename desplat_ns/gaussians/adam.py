"""Adam in one pass over the parameters, where torch can."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn
from torch.optim import Optimizer

EPSILON = 1e-15
"""Splatfacto's: gradients of Gaussians are small."""


def adam(params: list[nn.Parameter], lr: float, **options: Any) -> Optimizer:
    """Adam that updates moments and parameters in one pass, a third of the time on a CPU; in
    several, to the same values up to rounding, where torch has no fused one for the parameters'
    device or type.

    Args:
        options: others of `torch.optim.Adam`.
    """
    options = {"eps": EPSILON} | options
    try:
        return torch.optim.Adam(params, lr=lr, fused=True, **options)
    except RuntimeError as error:
        if "fused" not in str(error):  # torch names the option that it refuses
            raise
    return torch.optim.Adam(params, lr=lr, **options)
