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

from desplat_ns.backend.protocol import View
from desplat_ns.separation.grid import grid_of


class LastRegions:
    """By the number of the view, on the grid of the photo's size at that visit."""

    def __init__(self) -> None:
        self._found: dict[int, Tensor] = {}

    def keep(self, index: int, regions: Bool[Tensor, "rows columns"]) -> None:
        """Take up those of a visit of view `index`."""
        self._found[index] = regions

    def of(self, index: int, view: View) -> Bool[Tensor, "rows columns"] | None:
        """Those of a view that is visited again, on its grid of now; None if it has none."""
        found = self._found.get(index)
        if found is None:
            return None
        columns, rows = grid_of(view.width, view.height)
        return F.interpolate(found[None, None].to(torch.float32), size=(rows, columns))[0, 0] > 0

    def state_dict(self) -> dict[int, Tensor]:
        """For a checkpoint."""
        return dict(self._found)

    def load_state_dict(self, state: dict[int, Any], device: torch.device) -> None:
        """Take up what `state_dict` gave, on `device`."""
        self._found = {index: found.to(device) for index, found in state.items()}
