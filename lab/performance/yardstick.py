"""The yardstick: batched alpha blending as one writes it first in torch, with plain autograd.

Tiles are taken in batches, sorted by the length of their lists, and padded to the longest of their
batch. Projection and lists are the `torch` backend's; nothing else is shared with any backend, and
nothing is clever. It stays as it is, so that ratios to it can be compared over the years.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.projection import ProjectedSplats, project
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from desplat_ns.backend.tile_lists import TILE, TileLists, from_tiles, tile_lists
from lab.pixels.contenders import Contender

TILES_AT_ONCE = 16
"""The fastest of 4, 8, ..., 128 on 20,000 Gaussians: by 1% over its neighbours, by 20% over 128."""


class Yardstick:
    """See `protocol.Rasterizer`; it has no absgrad."""

    name = "yardstick"

    def __call__(self, splats: Splats, view: View, settings: RenderSettings) -> Rendering:
        """Rasterize `splats` seen from `view`."""
        projected = project(splats, view, settings)
        lists = tile_lists(projected, view.width, view.height)
        return draw(projected, lists, view, settings)


def draw(
    projected: ProjectedSplats, lists: TileLists, view: View, settings: RenderSettings
) -> Rendering:
    """What is left of rasterization once the lists are there."""
    image = blend(projected, lists, (view.width, view.height))
    rgb, alpha, depth = image[..., :-2], image[..., -2:-1], image[..., -1:]
    depth = depth / alpha.clamp(min=1e-10) if settings.depth else None
    return Rendering(rgb, alpha, depth, projected.means2d, projected.radii)


def blend(projected: ProjectedSplats, lists: TileLists, size: tuple[int, int]) -> Tensor:
    """Colours, alpha and sum of w z, [H, W, C + 2]."""
    depths = projected.depths[:, None]
    features = torch.cat([projected.colors, torch.ones_like(depths), depths], dim=-1)
    by_tile = lists.gaussians.split(lists.counts.tolist())
    order = lists.counts.argsort()
    blended = []
    for tiles in order.split(TILES_AT_ONCE):
        ids = pad_sequence([by_tile[tile] for tile in tiles.tolist()], batch_first=True)
        listed = torch.arange(ids.shape[1], device=ids.device) < lists.counts[tiles, None]
        weights = _weights(projected, ids, listed, _pixels(tiles, lists.columns, depths))
        blended.append(features[ids].mT @ weights)
    return from_tiles(torch.cat(blended)[order.argsort()], lists, size)


def _pixels(tiles: Tensor, columns: int, like: Tensor) -> Tensor:
    """Centres (x, y) of the pixels of some tiles, [2, B, 1, P]."""
    within = torch.arange(TILE * TILE, device=tiles.device)
    x = (tiles % columns * TILE)[:, None] + within % TILE
    y = (tiles // columns * TILE)[:, None] + within // TILE
    return torch.stack([x, y])[:, :, None].to(like.dtype) + 0.5


def _weights(projected: ProjectedSplats, ids: Tensor, listed: Tensor, pixels: Tensor) -> Tensor:
    """alpha * transmittance of the Gaussians `ids` [B, S] at the tiles' pixels, [B, S, P]."""
    dx, dy = projected.means2d[0, ids].unsqueeze(-1).unbind(-2)
    dx, dy = dx - pixels[0], dy - pixels[1]
    xx, xy, yy = projected.conics[ids].unsqueeze(-1).unbind(-2)
    sigma = 0.5 * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
    alpha = projected.opacities[ids].unsqueeze(-1) * torch.exp(-sigma)
    alpha = alpha.clamp(max=ALPHA_MAX)
    alpha = torch.where(listed.unsqueeze(-1) & (alpha >= ALPHA_CUTOFF), alpha, 0.0)
    behind = torch.cumprod(1 - alpha, dim=1)
    before = torch.cat([torch.ones_like(behind[:, :1]), behind[:, :-1]], dim=1)
    return torch.where(behind > TRANSMITTANCE_MIN, alpha * before, 0.0)


YARDSTICK = Contender(
    Yardstick.name, "cpu", Yardstick(), seam="project", address=f"{__name__}:YARDSTICK"
)
