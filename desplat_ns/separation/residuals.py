"""Finds what one photo shows and the other views do not: its residual beyond the expected one.

A place that the scene has not learned is missed in every view that sees it, and an occluder stands
in one. So each static Gaussian remembers the median of the residuals around it, which an occluder
in fewer than half of its views does not move; that is expected there. Residuals are relative to the
view's own level, since exposure, progress and resets move all cells alike.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from desplat_ns.separation.grid import pooled, window_means

SMOOTHING = 3
"""Cells (an odd number) over which colours are averaged, fine ones, and residuals, so that neither
texture counts nor what is only not sharp yet."""

EXPECTED_WINDOW = 5
"""Cells (an odd number) over which Gaussians say what is expected."""

LEVEL_QUANTILE = 0.25
"""A view's level is this quantile of its residuals, which falls as the scene is learned: right as
long as occluders cover less than three quarters of the view."""

MEDIAN_STEP = 0.1
"""Step of a Gaussian's running median, in units of the residual's logarithm."""

RESIDUAL_MEDIANS = "usual_residual"
"""Key in the running state of gsplat's strategy, which copies and removes the rows of every tensor
in it together with the Gaussians, and which checkpoints hold: their running medians of
log(residual / level of its view)."""

MIN_RESIDUAL = 1e-4
"""Below this, residuals (colours in [0, 1]) are equal."""


def local_residual(
    static: Float[Tensor, "3 fine_rows fine_columns"],
    photo: Float[Tensor, "3 fine_rows fine_columns"],
    grid: tuple[int, int],
) -> Float[Tensor, "rows columns"]:
    """Largest difference of the three colours, in [0, 1], averaged around each cell of `grid`.

    The difference is averaged before its absolute value is taken: what is only not sharp yet
    cancels out.
    """
    difference = window_means(static - photo, SMOOTHING).abs().amax(0)
    cells = pooled(difference[..., None], grid)
    return window_means(cells, SMOOTHING)[0].clamp(min=MIN_RESIDUAL)


def medians_in(state: Mapping[str, Any], count: int, device: torch.device) -> Float[Tensor, " N"]:
    """What `count` Gaussians remember in the strategy's state; zeros at first."""
    residual_medians = state.get(RESIDUAL_MEDIANS)
    return torch.zeros(count, device=device) if residual_medians is None else residual_medians


@dataclass(frozen=True)
class Excess:
    """How far a view's residuals are beyond the expected ones."""

    values: Float[Tensor, "rows columns"]
    """In colours in [0, 1]; below 0 where a residual is smaller than expected."""
    votes: Float[Tensor, "rows columns"]
    """Opacity per cell of the Gaussians around it that say what is expected."""


def excess_residual(
    residual: Float[Tensor, "rows columns"],
    means2d: Float[Tensor, "N 2"],
    visible: Bool[Tensor, " N"],
    opacities: Float[Tensor, " N"],
    residual_medians: Float[Tensor, " N"],
    counted: Bool[Tensor, "rows columns"] | None = None,
) -> tuple[Excess, Float[Tensor, " N"]]:
    """The residual beyond the expected one, and what the Gaussians remember with this view.

    What is usual around the Gaussians in a part of the image is expected there, each counting by
    its opacity; where there is none, the view's level is.

    Args:
        residual: `local_residual` of the view.
        means2d: projected centres, in cells.
        opacities: in [0, 1]; what is transparent has no weight.
        residual_medians: `medians_in` before this view; it is not written into.
        counted: cells that are not masked, None if none is. The others have no excess and no part
            in the level; to Gaussians in them this visit is none.
    """
    level = level_of(residual, counted)
    relative = F.pad((residual / level).log().flatten(), (0, 1))
    inside, cell = cells_of(means2d, visible, residual.shape, counted)
    expected, votes = _mean_by_cell(residual_medians, opacities, cell, residual.shape)
    off = torch.sign(relative.index_select(0, cell) - residual_medians)
    residual_medians = torch.add(residual_medians, off * inside, alpha=MEDIAN_STEP)
    values = residual - level * expected.exp()
    values = values if counted is None else values.masked_fill(~counted, 0.0)
    return Excess(values, votes), residual_medians


def level_of(
    residual: Float[Tensor, "rows columns"], counted: Bool[Tensor, "rows columns"] | None
) -> Float[Tensor, ""]:
    """The view's own level; of a view that is masked wholly any, as nobody asks for it."""
    if counted is None:
        values = residual.flatten()
        return values.kthvalue(math.ceil(LEVEL_QUANTILE * len(values)))[0]
    ordered = residual.masked_fill(~counted, torch.inf).flatten().sort().values
    place = (LEVEL_QUANTILE * counted.sum()).ceil().long().clamp(min=1) - 1
    return torch.where(counted.any(), ordered[place], MIN_RESIDUAL)


def cells_of(
    means2d: Tensor, visible: Tensor, shape: torch.Size, counted: Tensor | None
) -> tuple[Bool[Tensor, " N"], Int[Tensor, " N"]]:
    """Which Gaussians have their centre in the image and not in a masked cell, and their cells as
    flat indices; all others are in one cell more, behind the last."""
    rows, columns = shape
    x, y = means2d.floor().unbind(-1)
    inside = visible & (x.clamp(0, columns - 1) == x) & (y.clamp(0, rows - 1) == y)
    cell = torch.where(inside, torch.add(x, y, alpha=columns), rows * columns).long()
    if counted is None:
        return inside, cell
    inside = F.pad(counted.flatten(), (0, 1), value=False).index_select(0, cell)
    return inside, torch.where(inside, cell, rows * columns)


def _mean_by_cell(
    values: Float[Tensor, " N"], weights: Tensor, cell: Tensor, shape: torch.Size
) -> tuple[Float[Tensor, "rows columns"], Float[Tensor, "rows columns"]]:
    """Weighted mean of the values around each cell, 0 where nothing has weight; and the weights."""
    rows = torch.stack([weights * values, weights])
    sums = rows.new_zeros(2, shape[0] * shape[1] + 1).index_add_(1, cell, rows)
    total, weight = window_means(sums[:, :-1].reshape(2, *shape), EXPECTED_WINDOW)
    return total / weight.clamp(min=torch.finfo(rows.dtype).tiny), weight
