"""The `torch` backend: the readable statement of what every backend computes, in plain torch.

It takes any device and float dtype; gradients come from autograd. In each pixel, with Gaussians
1, 2, ... from front to back and d_i the mean of the i-th minus the pixel's centre,

    sigma_i = d_i^T conic_i d_i / 2
    alpha_i = min(ALPHA_MAX, opacity_i exp(-sigma_i)), or 0 if that is below ALPHA_CUTOFF
    T_i     = (1 - alpha_1) ... (1 - alpha_{i-1})
    w_i     = alpha_i T_i, or 0 from the first i on whose T_{i+1} is TRANSMITTANCE_MIN or less

and what is drawn is the sum of w_i times the i-th Gaussian's features: its colours, 1, its depth.
Tiles of 16 x 16 pixels are drawn one after the other, and each is drawn again in the backward pass,
so that the memory needed is that of one tile.

Letters in shapes, besides the protocol's: S Gaussians of a tile, P pixels of a tile, F features.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.projection import ProjectedSplats, project
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View

TILE = 16
"""Pixels along a tile's side."""

SLACK = 1e-3
"""Added to the squared extent, so that rounding never drops a Gaussian that a pixel would draw."""

WEIGHT_MIN = 1e-10
"""Floor of sum(w) under the expected depth (gsplat)."""


class TorchRasterizer:
    """Bundled rasterizer: a Gaussian shows wherever its alpha reaches ALPHA_CUTOFF."""

    name = "torch"

    def __call__(self, splats: Splats, view: View, settings: RenderSettings) -> Rendering:
        """Rasterize `splats` seen from `view`; raises ValueError where shapes do not fit."""
        projected = project(splats, view, settings)
        features = [projected.colors, torch.ones_like(projected.depths)[:, None]]
        if settings.depth:
            features.append(projected.depths[:, None])
        means2d, absgrad = projected.means2d, None
        if settings.absgrad:
            absgrad = torch.zeros_like(means2d)
            means2d.absgrad = absgrad  # pyright: ignore[reportAttributeAccessIssue]
        image = _draw(projected, torch.cat(features, dim=-1), view, absgrad)
        alpha = image[..., 3:4]
        depth = image[..., 4:] / alpha.clamp(min=WEIGHT_MIN)
        return Rendering(
            rgb=image[..., :3],
            alpha=alpha,
            depth=depth if settings.depth else None,
            means2d=means2d,
            radii=projected.radii,
        )


def _draw(
    projected: ProjectedSplats, features: Float[Tensor, "N F"], view: View, absgrad: Tensor | None
) -> Float[Tensor, "H W F"]:
    """Features summed up in each pixel; the backward pass adds the sum over pixels of
    |d loss / d mean| to `absgrad` [1, N, 2]."""
    columns, rows = -(-view.width // TILE), -(-view.height // TILE)
    listed, counts = tile_lists(projected, columns, rows)
    shapes = torch.cat([projected.means2d[0], projected.conics, projected.opacities[:, None]], -1)
    entries = torch.cat([shapes, features], dim=-1).index_select(0, listed)
    tiles, sizes = [], counts.tolist()
    for tile, (own, ids) in enumerate(zip(entries.split(sizes), listed.split(sizes), strict=True)):
        corner = (tile % columns * TILE, tile // columns * TILE)
        sums = None if absgrad is None else (absgrad[0], ids)
        tiles.append(
            checkpoint(_blend, own, corner, sums, use_reentrant=False, preserve_rng_state=False)
        )
    image = torch.stack(tiles).reshape(rows, columns, TILE, TILE, -1).transpose(1, 2)
    return image.reshape(rows * TILE, columns * TILE, -1)[: view.height, : view.width]


def _blend(
    entries: Float[Tensor, "S D"],
    corner: tuple[int, int],
    sums: tuple[Float[Tensor, "N 2"], Int[Tensor, " S"]] | None,
) -> Float[Tensor, "P F"]:
    """Features in the pixels of one tile.

    Args:
        entries: D = 6 + F numbers of each Gaussian, front to back: mean x, y; conic xx, xy, yy;
            opacity; features.
        corner: x and y of the tile's first pixel.
        sums: where |d loss / d mean| is added to in the backward pass, and the Gaussians' indices.
    """
    centers = torch.arange(TILE, dtype=entries.dtype, device=entries.device) + 0.5
    y, x = torch.meshgrid(centers + corner[1], centers + corner[0], indexing="ij")
    d = entries[:, None, :2] - torch.stack([x, y], dim=-1).reshape(1, -1, 2)
    if sums is not None and d.requires_grad:
        total, ids = sums

        def add(grad: Tensor) -> None:
            total.index_add_(0, ids, grad.abs().sum(dim=1))

        d.register_hook(add)
    xx, xy, yy, opacity = entries[:, 2:6, None].unbind(dim=1)
    dx, dy = d.unbind(dim=-1)
    sigma = 0.5 * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
    # Rounding may turn sigma of a needle negative.
    alpha = (opacity * torch.exp(-sigma.clamp(min=0))).clamp(max=ALPHA_MAX)
    alpha = torch.where(alpha >= ALPHA_CUTOFF, alpha, 0)
    after = torch.cumprod(1 - alpha, dim=0)
    before = torch.cat([torch.ones_like(after[:1]), after[:-1]])
    weights = torch.where(after > TRANSMITTANCE_MIN, alpha * before, 0)
    return weights.T @ entries[:, 6:]


@torch.no_grad()
def tile_lists(
    projected: ProjectedSplats, columns: int, rows: int
) -> tuple[Int[Tensor, " pairs"], Int[Tensor, " tiles"]]:
    """The Gaussians of each tile, front to back and by index where depths are equal, tile after
    tile; and how many each tile has. Tiles are numbered row by row.

    A Gaussian is in the tiles of its bounding box, beyond which its alpha is below ALPHA_CUTOFF.
    """
    visible = ((projected.radii > 0) & (projected.opacities >= ALPHA_CUTOFF)).nonzero()[:, 0]
    visible = visible[projected.depths[visible].sort(stable=True).indices]
    means, (xx, xy, yy) = projected.means2d[0, visible], projected.conics[visible].unbind(-1)
    # sigma <= reach is alpha >= ALPHA_CUTOFF; along x that ends at sqrt(2 reach yy / det).
    reach = torch.log(projected.opacities[visible] / ALPHA_CUTOFF) * (1 + SLACK) + SLACK
    # The lower end of what rounding leaves open: a box may be too large, never too small.
    finfo = torch.finfo(xx.dtype)
    det = (xx * yy * (1 - 4 * finfo.eps) - xy * xy).clamp(min=finfo.tiny)
    half = (2 * reach[:, None] * torch.stack([yy, xx], dim=-1) / det[:, None]).sqrt() + SLACK
    grid = means.new_tensor([columns, rows])
    low = torch.minimum(((means - half) / TILE).floor().clamp(min=0), grid).long()
    high = torch.minimum(((means + half) / TILE).ceil().clamp(min=0), grid).long()
    across, down = (high - low).clamp(min=0).unbind(-1)
    counts = across * down
    box = torch.repeat_interleave(counts)
    place = torch.arange(len(box), device=box.device) - (counts.cumsum(0) - counts)[box]
    row = low[box, 1] + torch.div(place, across[box], rounding_mode="floor")
    tile = row * columns + low[box, 0] + place % across[box]
    order = tile.sort(stable=True).indices
    return visible[box[order]], torch.bincount(tile, minlength=columns * rows)
