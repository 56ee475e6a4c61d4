"""Which Gaussians can be seen in which tile, exactly: the ellipse where alpha >= ALPHA_CUTOFF.

gsplat 1.4 lists the square of 3 sigma instead, which is a third longer and cuts off what an opaque
Gaussian still shows there (up to 3e-3 of its colour).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Int, Shaped
from torch import Tensor

from desplat_ns.backend.constants import ALPHA_CUTOFF
from desplat_ns.backend.projection import ProjectedSplats

TILE = 16
"""Pixels along a tile's side. 8 and 32 were slower."""

SLACK = 1e-3
"""Added to the squared extent, so that rounding never drops a Gaussian that a pixel would draw."""

PAIRS_AT_ONCE = 1 << 20
"""Gaussian-tile pairs tested together; bounds the memory of large Gaussians."""


@dataclass(frozen=True)
class TileLists:
    """Gaussians per tile, nearest first, ties by index. Tiles are numbered row by row."""

    gaussians: Int[Tensor, " pairs"]
    """Indices of Gaussians, tile after tile."""
    starts: Int[Tensor, " tiles"]
    counts: Int[Tensor, " tiles"]
    columns: int
    rows: int


def tile_grid(width: int, height: int) -> tuple[int, int]:
    """Columns and rows of tiles that cover the image."""
    return -(-width // TILE), -(-height // TILE)


@torch.no_grad()
def tile_lists(projected: ProjectedSplats, width: int, height: int) -> TileLists:
    """List, for each tile, the Gaussians whose alpha reaches ALPHA_CUTOFF somewhere in it."""
    columns, rows = tile_grid(width, height)
    # Front to back; the stable sort keeps the index order among equal depths.
    visible = ((projected.radii > 0) & (projected.opacities >= ALPHA_CUTOFF)).nonzero()[:, 0]
    visible = visible[torch.sort(projected.depths[visible], stable=True).indices]
    means, conics = projected.means2d[0, visible], projected.conics[visible]
    # sigma <= reach is alpha >= cutoff.
    reach = torch.log(projected.opacities[visible] / ALPHA_CUTOFF) * (1 + SLACK) + SLACK
    low, high = _tile_bounds(means, conics, reach, columns, rows)
    tiles, ranks = [], []
    for chunk in _chunks((high - low).prod(dim=-1)):
        tile, rank = pairs_of_boxes(low[chunk], high[chunk], columns)
        rank = rank + chunk.start
        near = _least_sigma(means[rank], conics[rank], tile, columns) <= reach[rank]
        tiles.append(tile[near])
        ranks.append(rank[near])
    return sorted_lists(torch.cat(tiles), torch.cat(ranks), visible, (columns, rows))


def sorted_lists(
    tile: Int[Tensor, " pairs"],
    rank: Int[Tensor, " pairs"],
    visible: Int[Tensor, " ranks"],
    grid: tuple[int, int],
) -> TileLists:
    """Lists of (tile, rank) pairs in any order. `visible` are the Gaussians by rank, front to
    back."""
    columns, rows = grid
    # One key per pair, (tile, depth, index): what to sort is 64 bits wide once instead of twice.
    key = torch.sort(tile * len(visible) + rank).values
    counts = torch.bincount(tile, minlength=columns * rows)
    return TileLists(
        gaussians=visible[key % max(len(visible), 1)],
        starts=counts.cumsum(0) - counts,
        counts=counts,
        columns=columns,
        rows=rows,
    )


def inside(lists: TileLists, size: tuple[int, int]) -> Bool[Tensor, "tiles P"]:
    """Which pixels of the tiles belong to the image."""
    image = torch.ones(size[1], size[0], 1, dtype=torch.bool, device=lists.counts.device)
    return to_tiles(image, lists)[:, 0]


def to_tiles(image: Shaped[Tensor, "H W F"], lists: TileLists) -> Shaped[Tensor, "tiles F P"]:
    """[H, W, F] to [tiles, F, P], padded with zeros."""
    height, width, channels = image.shape
    padding = (0, 0, 0, lists.columns * TILE - width, 0, lists.rows * TILE - height)
    image = torch.nn.functional.pad(image, padding)
    image = image.reshape(lists.rows, TILE, lists.columns, TILE, channels)
    return image.permute(0, 2, 4, 1, 3).reshape(-1, channels, TILE * TILE)


def from_tiles(
    tiles: Shaped[Tensor, "tiles F P"], lists: TileLists, size: tuple[int, int]
) -> Shaped[Tensor, "H W F"]:
    """[tiles, F, P] to [H, W, F]."""
    channels = tiles.shape[1]
    image = tiles.reshape(lists.rows, lists.columns, channels, TILE, TILE).permute(0, 3, 1, 4, 2)
    image = image.reshape(lists.rows * TILE, lists.columns * TILE, channels)
    return image[: size[1], : size[0]].contiguous()


def _tile_bounds(
    means: Tensor, conics: Tensor, reach: Tensor, columns: int, rows: int
) -> tuple[Tensor, Tensor]:
    """First and one past the last tile (column, row) of each ellipse's bounding box, [N, 2]."""
    xx, xy, yy = conics.unbind(-1)
    # The lower end of what rounding leaves open: a box may be too large, never too small.
    finfo = torch.finfo(xx.dtype)
    det = (xx * yy * (1 - 4 * finfo.eps) - xy * xy).clamp(min=finfo.tiny)
    half = (2 * reach[:, None] * torch.stack([yy, xx], dim=-1) / det[:, None]).sqrt() + SLACK
    limit = means.new_tensor([columns, rows])
    low = torch.minimum(((means - half) / TILE).floor().clamp(min=0), limit)
    high = torch.minimum(((means + half) / TILE).ceil().clamp(min=0), limit)
    return low.long(), torch.maximum(low, high).long()


def _chunks(counts: Tensor) -> list[slice]:
    """Cut the Gaussians into runs of about PAIRS_AT_ONCE pairs each."""
    if len(counts) == 0:
        return [slice(0, 0)]
    group = (counts.cumsum(0) - counts) // PAIRS_AT_ONCE
    sizes = torch.unique_consecutive(group, return_counts=True)[1].tolist()
    ends = torch.tensor(sizes).cumsum(0).tolist()
    return [slice(end - size, end) for size, end in zip(sizes, ends, strict=True)]


def pairs_of_boxes(low: Tensor, high: Tensor, columns: int) -> tuple[Tensor, Tensor]:
    """Every tile of every box: its number, and the box's index."""
    extent = high - low
    counts = extent.prod(dim=-1)
    box = torch.repeat_interleave(counts)
    within = torch.arange(len(box), device=box.device) - (counts.cumsum(0) - counts)[box]
    across = extent[box, 0]
    down = torch.div(within, across, rounding_mode="floor")
    return (low[box, 1] + down) * columns + low[box, 0] + within - down * across, box


def _least_sigma(means: Tensor, conics: Tensor, tile: Tensor, columns: int) -> Tensor:
    """The least (x - mean)^T conic (x - mean) / 2 over the pixel centres' rectangle of each tile.

    A convex quadratic is least at the mean if that lies inside, else on the nearest vertical or
    the nearest horizontal edge, where one coordinate is fixed and the other has a closed form.
    """
    corner = torch.stack([tile % columns, tile // columns], dim=-1) * TILE
    (x0, y0), (x1, y1) = ((corner + o - means).unbind(-1) for o in (0.5, TILE - 0.5))
    xx, xy, yy = conics.unbind(-1)
    zero = torch.zeros_like(x0)
    edge_x, edge_y = zero.clamp(x0, x1), zero.clamp(y0, y1)
    on_x = (-xy * edge_x / yy).clamp(y0, y1)
    on_y = (-xy * edge_y / xx).clamp(x0, x1)
    return torch.minimum(
        0.5 * (xx * edge_x * edge_x + yy * on_x * on_x) + xy * edge_x * on_x,
        0.5 * (xx * on_y * on_y + yy * edge_y * edge_y) + xy * on_y * edge_y,
    )
