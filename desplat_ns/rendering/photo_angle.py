"""How far a view is from the photos: the angle under which they see what it shows.

Where a photo looks at a place from the same side, its colour is known; where two do, its depth is,
too. From elsewhere nobody has said how the place looks.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.protocol import View
from desplat_ns.rendering.near_plane import sampled
from desplat_ns.rendering.views import image_points

POINTS = 1_000
"""Of the reconstruction, evenly chosen; a view shows some hundreds of them."""

PHOTOS = 2
"""That have to see a point: one gives its colour, and two its depth."""


class PhotoAngle:
    """Measures views of a capture against its training photos."""

    def __init__(self, points: Float[Tensor, "P 3"], views: Sequence[View]):
        """Args:
        points: of the reconstruction.
        views: of the training photos.
        """
        self.points = sampled(points, POINTS)
        rays = [self._rays(view) * self._shown(view)[:, None] for view in views]
        self.rays = torch.stack(rays)
        """From the photos to the points [V, P, 3], of length 1; 0 where a photo does not show the
        point."""

    def _rays(self, view: View) -> Float[Tensor, "P 3"]:
        return torch.nn.functional.normalize(self.points - view.center, dim=-1)

    def _shown(self, view: View) -> Tensor:
        u, v, depth = image_points(self.points, view)
        return (depth > 0) & (u >= 0) & (u < 1) & (v >= 0) & (v < 1)

    @torch.no_grad()
    def degrees(self, view: View) -> float | None:
        """Within how many degrees, in [0, 90], two photos see half of the points that a view shows.

        The angle is that at the point, between the rays to it. Photos that see it from more than a
        right angle away, or not at all, count as 90. None where the view shows no point.
        """
        shown = self._shown(view)
        if not bool(shown.any()) or len(self.rays) < PHOTOS:
            return None
        cosines = (self.rays[:, shown] * self._rays(view)[shown]).sum(dim=-1).clamp(0, 1)
        enough = cosines.topk(PHOTOS, dim=0).values[-1]
        return float(torch.rad2deg(enough.median().acos()))
