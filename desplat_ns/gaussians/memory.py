"""What is remembered of each static Gaussian, besides its parameters."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor


class GaussianMemory:
    """Named values, one for each static Gaussian, that follow clones, splits and prunes.

    They lie in the running state of gsplat's strategy, which copies and removes the rows of every
    tensor in it together with the Gaussians, and which checkpoints hold. Tensors are replaced and
    never written into.
    """

    def __init__(self, state: dict[str, Any]):
        """`state`: the strategy's."""
        self._state = state

    def values(self, name: str, count: int, device: torch.device) -> Float[Tensor, " N"]:
        """Read the values called `name` of `count` Gaussians, zeros if none are remembered yet."""
        values = self._state.get(name)
        if values is None:
            return torch.zeros(count, device=device)
        assert len(values) == count, f"{name} is remembered of {len(values)} Gaussians, not {count}"
        return values

    def number(self, name: str) -> int:
        """Read a number that belongs to the set as a whole, 0 if nothing is remembered yet."""
        return self._state.get(name, 0)

    def remember(self, **values: Float[Tensor, " N"] | int) -> None:
        """Replace values and numbers by name."""
        self._state.update(values)
