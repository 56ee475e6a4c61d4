"""One training view as a step saw it."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.protocol import View


@dataclass
class Sighting:
    """One training view as a step saw it."""

    index: int
    view: View
    photo: Float[Tensor, "H W 3"]
    alpha_d: Float[Tensor, "H W 1"]
    inside: Bool[Tensor, "rows columns"] | None = None
    """Where its distractors belong, on the grid of `grid_of`; None as long as nobody looked."""
    left_out: Bool[Tensor, "rows columns"] | None = None
    """Regions that the static scene's own loss leaves out; None for none."""
