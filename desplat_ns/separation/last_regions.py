"""Remembers the regions of each view's last visit.

What is faint is found early, and begins to be learned before distractors hide it; then it stands
out less, its region would vanish, and with it the distractors that keep it from being learned. So a
region that is there stays with less evidence than a new one needs, until the static scene's loss
leaves regions out: that buys distractors time to cover it. What has no full evidence then is given
up.

Source: the hysteresis of Canny 1986, in time.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Bool
from torch import Tensor

from desplat_ns.separation.grid import grid_of
from desplat_ns.separation.visit import Visit


class LastRegions:
    """By the number of the view, on the grid of the photo's size at that visit."""

    def __init__(self) -> None:
        self._found: dict[int, Tensor] = {}

    def keep(self, visit: Visit) -> None:
        """Take up a sound visit."""
        if visit.standing is not None:
            self._found[visit.index] = visit.standing

    def of(self, visit: Visit) -> Bool[Tensor, "rows columns"] | None:
        """Those of the view that is visited again, on its grid of now; None if it has none."""
        found = self._found.get(visit.index)
        if found is None:
            return None
        columns, rows = grid_of(visit.view.width, visit.view.height)
        return F.interpolate(found[None, None].to(torch.float32), size=(rows, columns))[0, 0] > 0

    def state_dict(self) -> dict[int, Tensor]:
        """For a checkpoint."""
        return dict(self._found)

    def load_state_dict(self, state: dict[int, Any], device: torch.device) -> None:
        """Take up what `state_dict` gave, on `device`."""
        self._found = {index: found.to(device) for index, found in state.items()}
