"""Between the host and the device: copies that wait once, or not at all."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor


def state_to_device(state: Mapping[Any, Any], device: torch.device) -> dict[Any, Any]:
    """A running state with its tensors on `device`."""
    return {k: v.to(device) if isinstance(v, Tensor) else v for k, v in state.items()}


def masks_to_host(*masks: Bool[Tensor, "..."]) -> list[Bool[np.ndarray, "..."]]:
    """Copies of masks of any shapes on the host, which waits once."""
    flat = torch.cat([mask.flatten() for mask in masks]).cpu().numpy()
    ends = np.cumsum([mask.numel() for mask in masks])
    parts = np.split(flat, ends[:-1])
    return [part.reshape(mask.shape) for part, mask in zip(parts, masks, strict=True)]


def to_device(values: np.ndarray, device: torch.device) -> Tensor:
    """A copy on the device. Nothing waits: a GPU fetches it from pinned memory in its turn."""
    tensor = torch.from_numpy(values)
    if device.type == "cuda":
        return tensor.pin_memory().to(device, non_blocking=True)
    return tensor.to(device)
