"""How far a photo contradicts the other photos, told from the photos alone.

What the static scene makes of a place cannot be judged by the static scene: a ghost that one photo
left behind stands out in all photos that are right, and what they then leave out is never learned.
But what is part of the scene has some depth at which the other photos show the same colour, whether
it has been learned or not; something that stands in one photo has none, but by chance.

Source: plane sweep of Collins 1996, with the median of the other photos.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.protocol import View
from desplat_ns.rendering.views import held, image_points
from desplat_ns.separation.grid import counted_cells, grid_of, pooled
from desplat_ns.separation.visit import Visit

CELLS = 2000
"""Cells per photo, a quarter of those that residuals have: in finer ones it takes four times as
long, and finds hardly more."""

NEIGHBOURS = 8
"""Photos that a photo is compared with, at most: those taken nearest to it, in a like direction."""

DEPTHS = 40
"""Depths that are tried, even in 1 / depth; the last is infinity, for the sky."""

NEAREST_SHARE = 0.5
"""The nearest depth that is tried, as a share of the median depth of the scene in the view."""

LEAST_WITNESSES = 2
"""A depth at which fewer of the other photos show the place does not count."""

UNKNOWN = 1.0
"""Contradiction of what cannot be judged: the largest there is."""


@dataclass(frozen=True)
class CellPhoto:
    """A photo in `CELLS` cells."""

    colors: Float[Tensor, "3 rows columns"]
    """In [0, 1]."""
    counted: Bool[Tensor, "rows columns"] | None
    """The cells that are not masked, None if none is."""
    view: View
    """Of the photo, in its pixels."""

    @classmethod
    def of(cls, visit: Visit) -> CellPhoto:
        """The photo that is visited, without the user's mask."""
        grid = grid_of(visit.view.width, visit.view.height, CELLS)
        counted = None if visit.mask is None else counted_cells(visit.mask, grid)
        return cls(pooled(visit.photo, grid, visit.mask), counted, held(visit.view))


class ComparedPhotos:
    """Collects the photos of a round of visits, then compares each with the others, once."""

    def __init__(self, num_views: int):
        self._num_views = num_views
        self._photos: dict[int, CellPhoto] = {}
        self._found: dict[int, Tensor] = {}

    def keep(self, visit: Visit) -> None:
        """Take up a sound visit: its photo, unless there is one of the view, and what was found.

        Once all photos are compared, none is needed any more.
        """
        if visit.contradiction is not None:
            self._found[visit.index] = visit.contradiction
        if len(self._found) == self._num_views:
            self._photos.clear()
        elif visit.index not in self._photos:
            self._photos[visit.index] = CellPhoto.of(visit)

    def compare(
        self, visit: Visit, means: Float[Tensor, "N 3"]
    ) -> Float[Tensor, "rows columns"] | None:
        """`contradiction` of the photo that is visited, on the grid of `grid_of`; None until all
        photos were kept. The visit notes it.

        Args:
            means: of the static Gaussians; those in view say how far the scene is.
        """
        found = self._found.get(visit.index)
        if found is None:
            if len(self._photos) < self._num_views:
                return None
            photo = self._photos[visit.index]
            others = [other for other in self._photos.values() if other is not photo]
            depths = image_points(means.detach(), visit.view)[2]
            depth = depths.where(visit.static.visible, torch.nan).nanmedian()
            found = contradiction(photo, nearest(photo, others, depth), depth)
        visit.contradiction = found
        columns, rows = grid_of(visit.view.width, visit.view.height)
        return F.interpolate(found[None, None], size=(rows, columns))[0, 0]

    def state_dict(self) -> dict[str, Any]:
        """What was found, and the photos that are still needed, by the number of the view."""
        photos = {index: asdict(photo) for index, photo in self._photos.items()}
        return {"found": dict(self._found), "photos": photos}

    def load_state_dict(self, state: dict[str, Any], device: torch.device) -> None:
        """Take up what `state_dict` gave, on `device`."""
        self._found = {index: found.to(device) for index, found in state["found"].items()}
        self._photos = {i: _photo_from(saved, device) for i, saved in state["photos"].items()}


def _photo_from(saved: dict[str, Any], device: torch.device) -> CellPhoto:
    view, counted = saved["view"], saved["counted"]
    at = View(view["viewmat"].to(device), view["K"].to(device), view["width"], view["height"])
    counted = None if counted is None else counted.to(device)
    return CellPhoto(saved["colors"].to(device), counted, at)


def nearest(
    photo: CellPhoto, others: Sequence[CellPhoto], depth: Float[Tensor, ""]
) -> list[CellPhoto]:
    """The `NEIGHBOURS` photos taken most nearly from the same place in the same direction.

    Args:
        depth: median depth of the scene in the photo, world units.
    """
    if not others:
        return []
    apart = torch.stack([_apart(photo.view, other.view, depth) for other in others])
    return [others[index] for index in apart.argsort()[:NEIGHBOURS].tolist()]


def contradiction(
    photo: CellPhoto, others: Sequence[CellPhoto], depth: Float[Tensor, ""]
) -> Float[Tensor, "rows columns"]:
    """By how much most other photos differ from what a photo shows, at the depth that suits best.

    For each cell and each depth: the median, over the others that show the place, of the largest
    difference of the three colours; of these the smallest. `UNKNOWN` where `LEAST_WITNESSES` others
    show it at no depth.

    Args:
        others: that are asked, all of them.
        depth: median depth of the scene in the photo, world units.
    """
    if len(others) < LEAST_WITNESSES:
        return torch.full_like(photo.colors[0], UNKNOWN)
    rays = _rays(photo)
    inverse = torch.linspace(1 / NEAREST_SHARE, 0.0, DEPTHS, device=rays.device) / depth
    differences = torch.stack([_difference(photo, other, rays, inverse) for other in others])
    ordered = differences.sort(dim=0).values  # who does not show it is infinitely off
    witnesses = ordered.isfinite().sum(dim=0, keepdim=True)
    median = ordered.gather(0, (witnesses - 1).clamp(min=0) // 2)[0]
    median = median.masked_fill(witnesses[0] < LEAST_WITNESSES, UNKNOWN)
    return median.amin(dim=0).reshape(photo.colors.shape[1:])


def _rays(photo: CellPhoto) -> Float[Tensor, "cells 3"]:
    """Directions through the cells' centres, in the camera's axes, of depth 1."""
    rows, columns = photo.colors.shape[1:]
    view, K = photo.view, photo.view.K
    at = {"device": K.device, "dtype": K.dtype}
    x = (torch.arange(columns, **at) + 0.5) * (view.width / columns)
    y = (torch.arange(rows, **at) + 0.5) * (view.height / rows)
    y, x = torch.meshgrid((y - K[1, 2]) / K[1, 1], (x - K[0, 2]) / K[0, 0], indexing="ij")
    return torch.stack([x, y, torch.ones_like(x)], dim=-1).reshape(-1, 3)


def _apart(one: View, other: View, depth: Float[Tensor, ""]) -> Float[Tensor, ""]:
    """How unlike two views are: the way between the cameras, in depths, and 1 - cos of the angle
    between their directions."""
    centres = [-view.viewmat[:3, :3].T @ view.viewmat[:3, 3] for view in (one, other)]
    cosine = one.viewmat[2, :3] @ other.viewmat[2, :3]
    return (centres[0] - centres[1]).norm() / depth + 1 - cosine


def _difference(
    photo: CellPhoto,
    other: CellPhoto,
    rays: Float[Tensor, "cells 3"],
    inverse_depths: Float[Tensor, " D"],
) -> Float[Tensor, "D cells"]:
    """Largest difference of the colours, of each cell at each depth; infinite where the other photo
    does not show it."""
    rotation = other.view.viewmat[:3, :3] @ photo.view.viewmat[:3, :3].T
    shift = other.view.viewmat[:3, 3] - rotation @ photo.view.viewmat[:3, 3]
    points = rays @ rotation.T + inverse_depths[:, None, None] * shift
    x, y, z = (points @ other.view.K.T).unbind(-1)
    shares = torch.stack([x / other.view.width, y / other.view.height], dim=-1)
    at = shares / z[..., None].clamp(min=1e-6) * 2 - 1
    shown = (z > 1e-6) & (at.abs() < 1).all(dim=-1)
    colors = F.grid_sample(other.colors[None], at[None], padding_mode="border", align_corners=False)
    if other.counted is not None:
        counted = F.grid_sample(other.counted[None, None].to(colors), at[None], align_corners=False)
        shown = shown & (counted[0, 0] > 0.5)
    off = (colors[0] - photo.colors.flatten(1)[:, None]).abs().amax(dim=0)
    return off.masked_fill(~shown, torch.inf)
