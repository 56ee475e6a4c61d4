"""The two ways between the host, which finds regions and rows, and the device, which does the rest.

A copy to the host waits until a GPU has done all that it was given: a step has as few as can be.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor


def to_host(values: Tensor) -> np.ndarray:
    """A copy on the host, for which it has to wait."""
    return values.detach().cpu().numpy()


def masks_to_host(*masks: Bool[Tensor, "..."]) -> list[Bool[np.ndarray, "..."]]:
    """Copies of masks of any shapes on the host, which waits once."""
    flat = to_host(torch.cat([mask.flatten() for mask in masks]))
    ends = np.cumsum([mask.numel() for mask in masks])
    parts = np.split(flat, ends[:-1])
    return [part.reshape(mask.shape) for part, mask in zip(parts, masks, strict=True)]


def to_device(values: np.ndarray, device: torch.device) -> Tensor:
    """A copy on the device. Nothing waits: a GPU fetches it from pinned memory in its turn."""
    tensor = torch.from_numpy(values)
    if device.type == "cuda":
        return tensor.pin_memory().to(device, non_blocking=True)
    return tensor.to(device)
