"""Finds the regions of a photo that show what the other views do not.

A place is in a region if the photo is farther from the static scene than most photos of the place
are, if other photos do not explain it, and if it does not show the scene's own detail in another
light. The outline of a region is drawn along the edges of the photo.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.core.devices import masks_to_host, to_device
from desplat_ns.separation.grid import fine_grid_of, grid_of, pooled, window_means
from desplat_ns.separation.residuals import SMOOTHING, Excess, excess_residual, local_residual


@dataclass(frozen=True)
class Thresholds:
    """All numbers by which `decide` decides; differences are of colours in [0, 1]."""

    weak: float = 0.05
    """Evidence of each cell of a region."""
    strong: float = 0.15
    """Evidence of a strong cell."""
    strong_share: float = 0.4
    """Share of a region's cells, of those of which anybody knows, that are strong or touch a strong
    one: in foliage single cells stand out."""
    trusted: float = 3.0
    """Times what is unexplained, the excess counts at most where the scene is known: a thing may
    look like something else at some depth by chance."""
    doubted: float = 0.5
    """The same where it is not: the excess itself is doubtful."""
    later: float = 0.2
    """Unexplained difference of a cell that founds a region where there was none at the photo's
    last visit: what stands out only then may be something that the scene is about to learn."""
    votes: float = 0.1
    """Opacity per cell of the Gaussians around it: with more, the scene is known."""
    opacity: float = 0.5
    """Of the static scene: below, what is behind it is more of a cell than the scene itself."""
    detail_window: int = 7
    """Fine cells (an odd number) over which detail is compared: in a wider window edges of what is
    in front count as its own detail far inside, in a narrower one there is little to compare."""
    detail_noise: float = 1e-3
    """Variance of grey that is no detail: before a bare wall, nobody can tell a light from a thing.
    """
    shared_detail: float = 0.7
    """Correlation of the detail of photo and scene above which it is the scene's in another light.
    """
    outline_window: int = 13
    """Cells (an odd number) over which a region is explained by the photo's colours."""
    small_window: int = 5
    """The same for a region of less than half of that window's cells, which it would vote down."""
    outline_noise: float = 1e-4
    """Variance of colours that is no edge."""


@dataclass(frozen=True)
class StaticView:
    """What a training view shows of the static scene, without gradients."""

    rgb: Float[Tensor, "H W 3"]
    """Over `behind`, in [0, 1]."""
    alpha: Float[Tensor, "H W 1"]
    behind: Float[Tensor, "*background 3"] | None
    """What is no scene and shows where the scene is transparent; None if it is scene, as a sky."""
    means2d: Float[Tensor, "N 2"]
    """Projected centres of its Gaussians, pixels."""
    visible: Bool[Tensor, " N"]
    opacities: Float[Tensor, " N"]
    """In [0, 1]."""


@dataclass(frozen=True)
class Comparison:
    """A photo beside the static scene."""

    static: Float[Tensor, "3 fine_rows fine_columns"]
    """In cells of `fine_grid_of`, colours in [0, 1]."""
    photo: Float[Tensor, "3 fine_rows fine_columns"]
    excess: Excess
    """On the grid of `grid_of`."""
    counted: Bool[Tensor, "rows columns"] | None
    """Cells that the user's mask leaves in; None if it leaves out none."""


def decide(
    comparison: Comparison,
    unexplained: Callable[[], Float[Tensor, "r c"] | None],
    by: Thresholds = Thresholds(),
    earlier: Bool[Tensor, "r c"] | None = None,
) -> Bool[Tensor, "rows columns"]:
    """Where a photo shows what other views do not, on the grid of `grid_of`; masked cells are in no
    region.

    A region is made of connected cells with an evidence (`evidence_of`) above `by.weak`. Of those
    of which anybody knows, `by.strong_share` have more than `by.strong` or touch one that has; one
    that has was in a region `earlier`, or more than `by.later` of it is unexplained.

    Args:
        unexplained: gives that of the photo, by `PlaneSweep.unexplained`, on any grid; None where
            nobody was asked, and the excess alone is the evidence. On the CPU it is called only
            where the excess would be enough.
    """
    excess, counted = comparison.excess, comparison.counted
    rows, columns = excess.values.shape
    grid = columns, rows
    if excess.values.is_cpu and not (excess.values.numpy() > by.strong).any():
        return torch.zeros_like(excess.values, dtype=torch.bool)  # as most photos, at no more cost
    evidence, left = evidence_of(excess, unexplained(), by)
    strong, is_known = evidence > by.strong, ~left.isnan()
    founding = strong & is_known
    if earlier is not None:
        founding &= (pooled(earlier.to(left)[..., None], grid)[0] > 0) | (left > by.later)
    if founding.is_cpu and not founding.numpy().any():
        return founding
    alike = shared_detail(comparison.static, comparison.photo, by)
    has_foreign_detail = pooled(alike[..., None], grid)[0] <= by.shared_detail
    weak = (evidence > by.weak) & has_foreign_detail
    colors = pooled(comparison.photo.permute(1, 2, 0), grid)
    regions = outlier_regions(weak, is_known, strong, founding, by)
    found = torch.zeros_like(founding)
    for part, window in zip(regions, (by.outline_window, by.small_window), strict=True):
        if part is not None:
            found |= along_edges(part, colors, window, by.outline_noise)
    return found if counted is None else found & counted


# --- colours --------------------------------------------------------------------------------------


def compare(
    photo: Float[Tensor, "H W 3"],
    static: StaticView,
    residual_medians: Float[Tensor, " N"],
    counted: Bool[Tensor, "rows columns"] | None = None,
) -> tuple[Comparison, Float[Tensor, " N"]]:
    """How far a photo is from the static scene, and what the Gaussians remember with this visit.

    Args:
        photo: in [0, 1]; under the user's mask as the static scene (`apply_mask`).
        residual_medians: what they remember of other visits (`medians_in`).
        counted: as `Comparison`'s.
    """
    height, width = photo.shape[:2]
    grid, fine = grid_of(width, height), fine_grid_of(width, height)
    colors_s, colors_p = pooled(static.rgb, fine), pooled(photo, fine)
    if static.behind is not None:
        behind = pooled(static.behind.expand_as(photo), fine)
        colors_s = own_colors(colors_s, pooled(static.alpha, fine), behind, colors_p)
    x, y = static.means2d.unbind(-1)
    excess, residual_medians = excess_residual(
        local_residual(colors_s, colors_p, grid),
        torch.stack([x * (grid[0] / width), y * (grid[1] / height)], dim=-1),
        static.visible,
        static.opacities,
        residual_medians,
        counted,
    )
    return Comparison(colors_s, colors_p, excess, counted), residual_medians


def own_colors(
    static: Float[Tensor, "3 r c"],
    alpha: Float[Tensor, "1 r c"],
    behind: Float[Tensor, "3 r c"],
    photo: Float[Tensor, "3 r c"],
    by: Thresholds = Thresholds(),
) -> Float[Tensor, "3 r c"]:
    """The colours of the static scene itself, whatever is behind it. Below an opacity of
    `by.opacity` they are drawn to the photo's: an empty scene contradicts nothing."""
    own = photo + (static - alpha * photo - (1 - alpha) * behind) / alpha.clamp(min=by.opacity)
    return own.clamp(0, 1)


@torch.no_grad()
def own_sky(
    photo: Float[Tensor, "H W 3"],
    alpha_s: Float[Tensor, "H W 1"],
    by: Thresholds = Thresholds(),
) -> Bool[Tensor, "rows columns"]:
    """Cells of `grid_of` that show no scene, and no detail in the photo.

    A background of each photo's own stands behind the scene there, so a photo that differs need not
    have anything in front. What has detail, if only at its edges, is judged as elsewhere.
    """
    height, width = photo.shape[:2]
    grid, fine = grid_of(width, height), fine_grid_of(width, height)
    grey = pooled(photo, fine).mean(dim=0)
    mean, square = window_means(torch.stack([grey, grey.square()]), by.detail_window)
    variance = pooled((square - mean.square())[..., None], grid)[0]
    return (variance < by.detail_noise) & (pooled(alpha_s, grid)[0] < by.opacity)


# --- evidence -------------------------------------------------------------------------------------


def evidence_of(
    excess: Excess, unexplained: Float[Tensor, "r c"] | None, by: Thresholds = Thresholds()
) -> tuple[Float[Tensor, "rows columns"], Float[Tensor, "rows columns"]]:
    """How much speaks for something in the way, in colours in [0, 1]: the excess, but not more than
    `by.trusted` or `by.doubted` times what other photos leave unexplained; and how much these do.

    Args:
        unexplained: NaN where nobody knows; there the excess is returned, and NaN.
    """
    if unexplained is None:
        return excess.values, torch.full_like(excess.values, torch.inf)
    rows, columns = excess.values.shape
    known = (~unexplained.isnan()).to(excess.values)
    left = pooled(unexplained.to(excess.values).nan_to_num()[..., None], (columns, rows))[0]
    is_known = pooled(known[..., None], (columns, rows))[0] >= 0.5
    times = torch.where(excess.votes >= by.votes, by.trusted, by.doubted)
    limited = torch.minimum(excess.values, times * left)
    evidence = torch.where(is_known, limited, excess.values)
    return evidence, left.masked_fill(~is_known, torch.nan)


# --- detail ---------------------------------------------------------------------------------------


def shared_detail(
    static: Float[Tensor, "3 fine_rows fine_columns"],
    photo: Float[Tensor, "3 fine_rows fine_columns"],
    by: Thresholds = Thresholds(),
) -> Float[Tensor, "fine_rows fine_columns"]:
    """Correlation of the grey of both in the surroundings of each cell, in [-1, 1]; colours are in
    [0, 1], in cells of `fine_grid_of`.

    Flare, exposure and shade change the colours of a place and leave its detail; something in front
    of it has detail of its own, or none. Both are smoothed, as the scene may not be sharp yet.

    Source: normalised cross-correlation, with a floor that stands for noise.
    """
    s, p = window_means(torch.stack([static.mean(dim=0), photo.mean(dim=0)]), SMOOTHING)
    s, p, ss, pp, sp = window_means(torch.stack([s, p, s * s, p * p, s * p]), by.detail_window)
    of_static = (ss - s * s).clamp(min=0) + by.detail_noise
    of_photo = (pp - p * p).clamp(min=0) + by.detail_noise
    return (sp - s * p) / (of_static * of_photo).sqrt()


# --- regions --------------------------------------------------------------------------------------


def outlier_regions(
    weak: Bool[Tensor, "rows columns"],
    is_known: Bool[Tensor, "rows columns"],
    strong: Bool[Tensor, "rows columns"],
    founding: Bool[Tensor, "rows columns"],
    by: Thresholds = Thresholds(),
) -> list[Bool[Tensor, "rows columns"] | None]:
    """Connected weak cells of whose known ones `by.strong_share` are strong or touch a strong one,
    and one founds it, found on the host; gaps are closed and holes filled. What is in the way is in
    places coloured like what it covers, and noise above the lower threshold alone is no reason.
    First those of at least half of `by.outline_window`'s cells, then the smaller; None for none.

    Source: hysteresis of Canny 1986; the share is ours.
    """
    weak_, known, strong_, start = masks_to_host(weak, weak & is_known, weak & strong, founding)
    labels = _parts(weak_)
    near = cv2.dilate((strong_ & known).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    cells, near_cells, start_cells = (
        np.bincount(labels[known & of], minlength=labels.max() + 1) for of in (known, near, start)
    )
    found = ((start_cells > 0) & (near_cells >= by.strong_share * cells))[labels]
    labels = _parts(_without_holes(_closed(found)))
    is_large = np.bincount(labels.ravel())[labels] >= by.outline_window**2 // 2
    both = (labels > 0) & is_large, (labels > 0) & ~is_large
    return [to_device(part, weak.device) if part.any() else None for part in both]


def _parts(mask: np.ndarray) -> np.ndarray:
    """Numbers, from 1 on, of the parts whose cells touch by a side or a corner; 0 elsewhere."""
    parts: tuple[int, np.ndarray] = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    return parts[1]


def _closed(mask: np.ndarray) -> np.ndarray:
    """Gaps of up to two cells closed; beyond the border it goes on as at the border."""
    padded = np.pad(mask.astype(np.uint8), 2, mode="edge")
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return closed[2:-2, 2:-2] > 0


def _without_holes(mask: np.ndarray) -> np.ndarray:
    """Filled where the outside of the image cannot be reached, by sides, through empty cells."""
    empty = np.pad(~mask, 1, constant_values=True).astype(np.uint8)
    _, labels = cv2.connectedComponents(empty, connectivity=4)
    return (labels != labels[0, 0])[1:-1, 1:-1]


def along_edges(
    regions: Bool[Tensor, "rows columns"],
    colors: Float[Tensor, "3 rows columns"],
    window: int = Thresholds.outline_window,
    noise: float = Thresholds.outline_noise,
) -> Bool[Tensor, "rows columns"]:
    """The regions, each cell given to the side whose colours it has in a window of so many cells.

    Residuals are averaged over some cells, so a region found in them ends some cells beyond the
    thing that it is for. Around each cell the regions are fitted by a linear function of the
    photo's colours, in [0, 1]; where the mean of all fits is above a half is inside.

    Source: guided filter of He, Sun and Tang 2010 (Eq. 14 to 16, with a colour guide).
    """
    colors = colors.double()  # grey surroundings make the systems below nearly singular
    inside = regions.to(colors)
    guide = window_means(colors, window)
    target = window_means(inside[None], window)[0]
    products = (colors[:, None] * colors).flatten(0, 1)
    products = window_means(products, window).unflatten(0, (3, 3))
    covariance = (products - guide[:, None] * guide).permute(2, 3, 0, 1)
    covariance = covariance + noise * torch.eye(3).to(colors)
    both = window_means(colors * inside, window) - guide * target
    slope = torch.linalg.solve_ex(covariance, both.permute(1, 2, 0))[0].permute(2, 0, 1)
    offset = target - (slope * guide).sum(dim=0)
    fitted = window_means(torch.cat([slope, offset[None]]), window)
    return (fitted[:3] * colors).sum(dim=0) + fitted[3] > 0.5
