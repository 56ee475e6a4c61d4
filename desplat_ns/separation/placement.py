"""What keeps the two sets apart when there are few visits: regions, placement, the static loss.

Eq. 5 alone leaves the sets a choice: while a distractor is faint, both get the same gradient, and
once the composite fits, neither gets any (docs/separation.md works it out for one pixel). What is
added here decides: distractors start only where a photo shows what the other views do not, go
where it does not, and the static scene has to fit by itself all pixels that they do not cover.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
from desplat_ns.separation.grid import grid_of, pooled
from jaxtyping import Bool, Float
from torch import Tensor
from torch.optim import Optimizer

from desplat_ns.backend.protocol import View
from desplat_ns.gaussians.densification import DistractorDensifier
from desplat_ns.gaussians.distractors import DistractorConfig, DistractorGaussians, distractors_at
from desplat_ns.rendering.views import image_points
from desplat_ns.separation.expected_residual import ExpectedResidual, local_residual
from desplat_ns.separation.regions import outlier_regions

COVERED_SHARE = 0.5
"""A distractor is placed where more than this share of its cell is inside a region, and where the
distractors' mean opacity is less than it."""

OWNED_MARGIN = 1.0
"""Cells of `grid_of` by which the pixels that distractors own reach beyond their edge: an edge is
half-transparent, and its leak would be learned."""


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


def peak_excess(step: int, visits: float, config: DistractorConfig) -> float:
    """Excess that a region has to reach in one place, at a step, after `visits` of each view.

    The lower one waits for the end of densification: a reset of the opacities lets the whole scene
    stand out for a while.
    """
    settled = step >= config.stop_densify_at and visits >= config.settled_visits
    return config.strong_excess * (config.settled_share if settled else 1)


def find_regions(
    step: int,
    static: Float[Tensor, "H W 3"],
    photo: Float[Tensor, "H W 3"],
    opacities: Float[Tensor, "N 1"],
    info: dict[str, Any],
    state: dict[str, Any],
    num_views: int,
    config: DistractorConfig,
) -> Bool[Tensor, "rows columns"]:
    """Regions of a photo that show what other views do not, on the grid of `grid_of`.

    Args:
        static: the static scene, rendered.
        opacities: logits of the static Gaussians.
        info: of the static rendering, as gsplat's strategies read it.
        state: running state of the static set's strategy; remembers the view.
        num_views: number of training views.
    """
    count, grid = len(opacities), grid_of(info["width"], info["height"])
    scale = photo.new_tensor([grid[0] / info["width"], grid[1] / info["height"]])
    residual = local_residual(static.detach(), photo, grid)
    expected = ExpectedResidual(state, count, photo)
    peak = peak_excess(step, expected.visits / num_views, config)
    excess = expected.excess(
        residual,
        info["means2d"].detach().reshape(count, 2) * scale,
        info["radii"].reshape(count, -1).amin(-1) > 0,
        torch.sigmoid(opacities.detach()[:, 0]),
        num_views,
    )
    return outlier_regions(excess, config.weak_excess, peak)


def pixels_of(
    regions: Bool[Tensor, "rows columns"], height: int, width: int
) -> Bool[Tensor, "H W 1"]:
    """The pixels whose cell is in a region."""
    cells = regions[None, None].to(torch.float32)
    return F.interpolate(cells, size=(height, width))[0, 0, :, :, None] > 0


def interior(regions: Bool[Tensor, "rows columns"]) -> Bool[Tensor, "rows columns"]:
    """Regions without their outermost cells; the image's border is no edge."""
    outside = F.pad((~regions).to(torch.float32), (1, 1, 1, 1))
    return F.max_pool2d(outside[None], 3, 1)[0] == 0


def owned_share(
    alpha_d: Float[Tensor, "H W 1"], regions: Bool[Tensor, "rows columns"] | None = None
) -> Float[Tensor, "H W 1"]:
    """How far distractors own a pixel, in [0, 1]: the largest of their opacities around it.

    A pixel in one of `regions` is theirs whatever they cover of it.
    """
    height, width = alpha_d.shape[:2]
    margin = round(OWNED_MARGIN * width / grid_of(width, height)[0])
    plane, window = alpha_d.detach()[..., 0], 2 * margin + 1
    rows = F.max_pool1d(plane, window, 1, margin)  # row by row: a tenth of max_pool2d's time
    owned = F.max_pool1d(rows.T.contiguous(), window, 1, margin).T[..., None]
    return owned if regions is None else owned.masked_fill(pixels_of(regions, height, width), 1.0)


def uncovered_regions(
    seen: Sighting, config: DistractorConfig
) -> Bool[Tensor, "grid_rows grid_columns"]:
    """Cells of a grid of `config.per_view` where distractors belong and none covers anything."""
    assert seen.inside is not None
    grid = grid_of(seen.view.width, seen.view.height, max(1, config.per_view))
    inside = pooled(seen.inside[..., None].to(torch.float32), grid)[0]
    covered = pooled(seen.alpha_d.detach(), grid)[0]
    return (inside >= COVERED_SHARE) & (covered < COVERED_SHARE)


def distractors_in(
    cells: Bool[Tensor, "grid_rows grid_columns"], seen: Sighting, config: DistractorConfig
) -> dict[str, Tensor]:
    """New distractors in the photo's colours, one for each cell that is set."""
    rows, columns = cells.shape
    row, column = cells.nonzero(as_tuple=True)
    x = (column + 0.5) * seen.view.width / columns
    y = (row + 0.5) * seen.view.height / rows
    colors = pooled(seen.photo, (columns, rows))[:, row, column].T.contiguous()
    return distractors_at(seen.view, config, torch.stack([x, y], dim=-1), colors)


def lie_in(
    regions: Bool[Tensor, "rows columns"], means: Float[Tensor, "N 3"], view: View
) -> Bool[Tensor, " N"]:
    """Which Gaussians have their centre in a region; beyond the border its nearest cell counts."""
    rows, columns = regions.shape
    u, v, _ = image_points(means.detach(), view)
    row, column = (v * rows).long(), (u * columns).long()
    return regions[row.clamp(0, rows - 1), column.clamp(0, columns - 1)]


class Placement:
    """Moves each view's distractors to its regions, once the optimizers have stepped."""

    def __init__(self, config: DistractorConfig, num_views: int):
        self.config = config
        self.num_views = num_views
        self._seen: Sighting | None = None

    @torch.no_grad()
    def look(
        self,
        step: int,
        seen: Sighting,
        static: Float[Tensor, "H W 3"],
        opacities: Float[Tensor, "N 1"],
        info: dict[str, Any],
        state: dict[str, Any],
    ) -> Bool[Tensor, "H W 1"] | None:
        """Find the view's regions, for `place`; the arguments are those of `find_regions`.

        Returns:
            The pixels in which opacity is free; None in the warm-up, in which views are only
            remembered. Residuals are averaged over some cells, so a region reaches beyond what
            stands there: distractors keep off its outermost cells, and are free one cell further
            in.
        """
        regions = find_regions(
            step, static, seen.photo, opacities, info, state, self.num_views, self.config
        )
        if step < self.config.static_warmup:
            return None
        seen.inside = interior(regions)
        if step < self.config.stop_placing_at:
            self._seen = seen
        if step >= self.config.leave_out_at:
            seen.left_out = regions
        return pixels_of(interior(seen.inside), *seen.photo.shape[:2])

    def forget(self) -> None:
        """Do not place anything for the view that was looked at last."""
        self._seen = None

    @torch.no_grad()
    def place(
        self,
        distractors: DistractorGaussians,
        densifier: DistractorDensifier,
        optimizers: dict[str, Optimizer],
    ) -> None:
        """Give the view that was looked at new distractors, and remove those out of place."""
        seen, self._seen = self._seen, None
        if seen is None:
            return
        assert seen.inside is not None
        keep = lie_in(seen.inside, distractors.params_of(seen.index)["means"], seen.view)
        uncovered = uncovered_regions(seen, self.config)
        if bool(uncovered.any()) or not bool(keep.all()):
            new = distractors_in(uncovered, seen, self.config)
            densifier.exchange(distractors, seen.index, optimizers, keep, new)
