"""The `torch` backend: exact rasterization in plain torch, any device and float dtype.

Tiles of 16 x 16 pixels are blended in batches, BATCH Gaussians of each tile's list at a time, so
that memory stays bounded and tiles that have become opaque drop out. The backward pass is analytic:
it needs the transmittance at the start of each batch and recomputes the rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from desplat_ns.backend.blending import Batch, Gradients, Scene
from desplat_ns.backend.constants import TRANSMITTANCE_MIN
from desplat_ns.backend.projection import project
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from desplat_ns.backend.tile_lists import (
    TILE,
    TileLists,
    from_tiles,
    inside,
    tile_lists,
    to_tiles,
)

BATCH = 32
"""Gaussians of one tile blended together: few enough that opaque tiles drop out soon."""

ELEMENTS = 1 << 18
"""Tile-Gaussian-pixel triples in one batch, on a CPU: what stays in the cache."""

ELEMENTS_CUDA = 1 << 24
"""The same on a GPU, where launching costs more than memory."""

WEIGHT_MIN = 1e-10
"""Floor of sum(w) under the expected depth (gsplat)."""


class TorchRasterizer:
    """Bundled rasterizer: a Gaussian shows wherever its alpha reaches ALPHA_CUTOFF."""

    name = "torch"

    def __call__(self, splats: Splats, view: View, settings: RenderSettings) -> Rendering:
        """Rasterize `splats` seen from `view`; raises ValueError where shapes do not fit."""
        projected = project(splats, view, settings)
        columns = [projected.colors, torch.ones_like(projected.depths)[:, None]]
        if settings.depth:
            columns.append(projected.depths[:, None])
        image: Tensor = _Blend.apply(
            projected.means2d,
            projected.conics,
            projected.opacities,
            torch.cat(columns, dim=-1),
            tile_lists(projected, view.width, view.height),
            (view.width, view.height),
            settings.absgrad,
        )
        channels = projected.colors.shape[-1]
        alpha = image[..., channels : channels + 1]
        depth = image[..., channels + 1 :] / alpha.clamp(min=WEIGHT_MIN)
        return Rendering(
            rgb=image[..., :channels],
            alpha=alpha,
            depth=depth if settings.depth else None,
            means2d=projected.means2d,
            radii=projected.radii,
        )


class _Blend(torch.autograd.Function):
    """Features of the Gaussians in each pixel, summed with weights w = alpha * transmittance."""

    @staticmethod
    def forward(
        ctx: Any,
        means2d: Float[Tensor, "1 N 2"],
        conics: Float[Tensor, "N 3"],
        opacities: Float[Tensor, " N"],
        features: Float[Tensor, "N F"],
        lists: TileLists,
        size: tuple[int, int],
        absgrad: bool,
    ) -> Float[Tensor, "H W F"]:
        scene = Scene(means2d[0], conics, opacities, features, lists)
        transmittance = inside(lists, size).to(means2d.dtype)
        summed = means2d.new_zeros(len(lists.counts), features.shape[-1], TILE * TILE)
        batches = []
        for tiles, steps in _schedule(lists, transmittance):
            batch = Batch(tiles, steps, transmittance[tiles])
            blend = scene.blend(batch)
            summed[tiles] += blend.features.mT @ blend.weights
            left = blend.transmittance[:, -1]
            transmittance[tiles] = left.masked_fill(left <= TRANSMITTANCE_MIN, 0)
            batches.append(batch)
        ctx.save_for_backward(means2d, conics, opacities, features)
        ctx.lists, ctx.batches, ctx.absgrad = lists, batches, absgrad
        return from_tiles(summed, lists, size)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_image: Float[Tensor, "H W F"]) -> tuple[Tensor | None, ...]:
        means2d, conics, opacities, features = ctx.saved_tensors
        scene = Scene(means2d[0], conics, opacities, features, ctx.lists)
        grads = Gradients(*(torch.zeros_like(t) for t in (means2d[0], conics, opacities)))
        grad_features, absgrad = torch.zeros_like(features), torch.zeros_like(means2d)
        grad_tiles = to_tiles(grad_image, ctx.lists)
        behind = grad_image.new_zeros(len(ctx.lists.counts), TILE * TILE)
        for batch in reversed(ctx.batches):
            blend, grad_out = scene.blend(batch), grad_tiles[batch.tiles]
            grad_features.index_add_(
                0, blend.ids.flatten(), (blend.weights @ grad_out.mT).flatten(0, 1)
            )
            grad_log_alpha, behind[batch.tiles] = blend.backward(grad_out, behind[batch.tiles])
            scene.add_gradients(grads, blend, batch, grad_log_alpha)
            if ctx.absgrad:
                scene.add_absgrad(absgrad[0], blend, batch, grad_log_alpha)
        if ctx.absgrad:
            means2d.absgrad = absgrad
        return grads.means[None], grads.conics, grads.opacities, grad_features, None, None, None


def _schedule(lists: TileLists, transmittance: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield tiles and places in their lists, front to back; opaque tiles drop out."""
    most = ELEMENTS_CUDA if transmittance.is_cuda else ELEMENTS
    at_once = max(1, most // (BATCH * TILE * TILE))
    first = 0
    while True:
        open_tiles = (lists.counts > first) & (transmittance > 0).any(dim=-1)
        tiles = open_tiles.nonzero()[:, 0]
        if len(tiles) == 0:
            return
        steps = torch.arange(first, first + BATCH, device=tiles.device)
        for chunk in tiles.split(at_once):
            yield chunk, steps
        first += BATCH
