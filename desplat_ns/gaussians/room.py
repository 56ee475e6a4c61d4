"""How many static Gaussians a device has room for while they are trained."""

from __future__ import annotations

import psutil
import torch

NUMBERS = 59
"""Of a Gaussian: 3 of its place, 3 of its size, 4 of its turn, its opacity, 48 of its colour."""

COPIES = 8
"""Of them in a step, float32: values, gradients, Adam's two moments; what is drawn of them and its
gradients; what the rasterizer keeps, or a refinement makes anew. At the peak 1,875 bytes were
measured for one more Gaussian (docs/results/speed.md), which is 7.9 times 59 numbers."""

SHARE = 0.5
"""Of the memory; the rest is for photos, images and other programs."""


def most_in_memory(device: str | torch.device) -> int:
    """Static Gaussians for which the device has room. The same at any load of the machine: it goes
    by what is built in."""
    device = torch.device(device)
    if device.type == "cuda":
        total = torch.cuda.get_device_properties(device).total_memory
    else:
        total = psutil.virtual_memory().total
    return int(SHARE * total) // (4 * NUMBERS * COPIES)
