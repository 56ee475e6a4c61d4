"""Alpha blending of one batch of tiles in plain torch, with its analytic gradients.

The readable statement of what every backend computes in a pixel, front to back:
alpha = min(ALPHA_MAX, opacity * exp(-sigma)), nothing if alpha < ALPHA_CUTOFF; the end before the
transmittance T * (1 - alpha) would fall to TRANSMITTANCE_MIN; weight = alpha * T.

Letters in shapes, besides the protocol's: B tiles of a batch, S Gaussians of each, P pixels of a
tile, F features (colours, one for alpha, depth).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.tile_lists import TILE, TileLists


@dataclass(frozen=True)
class Batch:
    """The next Gaussians of some tiles' lists."""

    tiles: Int[Tensor, " B"]
    steps: Int[Tensor, " S"]
    """Positions in each tile's list."""
    transmittance: Float[Tensor, "B P"]
    """Of each pixel before this batch; 0 where blending has stopped."""


@dataclass(frozen=True)
class Gradients:
    """Sums over pixels, one row for each Gaussian."""

    means: Float[Tensor, "N 2"]
    conics: Float[Tensor, "N 3"]
    opacities: Float[Tensor, " N"]


@dataclass(frozen=True)
class Blended:
    """One batch, front to back."""

    ids: Int[Tensor, "B S"]
    features: Float[Tensor, "B S F"]
    alpha: Float[Tensor, "B S P"]
    """0 where skipped."""
    clear: Float[Tensor, "B S P"]
    """1 - alpha, >= 1 - ALPHA_MAX."""
    transmittance: Float[Tensor, "B S+1 P"]
    """Before each Gaussian, and after the last."""
    weights: Float[Tensor, "B S P"]

    def backward(
        self, grad_out: Float[Tensor, "B F P"], behind: Float[Tensor, "B P"]
    ) -> tuple[Float[Tensor, "B S P"], Float[Tensor, "B P"]]:
        """Gradient with respect to log(alpha), and `behind` for the batch in front of this one.

        `behind` is the sum over all Gaussians further back of w_k g_k, g_k being the gradient along
        Gaussian k's features: d loss / d alpha_j = T_j g_j - (sum over k > j of w_k g_k) / (1 -
        alpha_j).
        """
        own = (self.features @ grad_out).mul_(self.weights)
        suffix = torch.empty_like(self.transmittance)
        suffix[:, -1] = behind
        for j in range(own.shape[1] - 1, -1, -1):
            torch.add(suffix[:, j + 1], own[:, j], out=suffix[:, j])
        grad = own - suffix[:, 1:].mul(self.alpha).div_(self.clear)
        return grad.masked_fill_(self.alpha >= ALPHA_MAX, 0), suffix[:, 0]


@dataclass(frozen=True)
class Scene:
    """Projected Gaussians and the tiles that they fall into."""

    means: Float[Tensor, "N 2"]
    conics: Float[Tensor, "N 3"]
    opacities: Float[Tensor, " N"]
    features: Float[Tensor, "N F"]
    lists: TileLists

    def blend(self, batch: Batch) -> Blended:
        """Alphas, transmittances and weights of one batch."""
        ids, listed = self._ids(batch)
        opacity = (self.opacities[ids] * listed)[..., None]
        log_alpha = self._log_alpha_terms(ids, batch, opacity[..., 0]) @ monomials(opacity)
        alpha = torch.minimum(log_alpha.exp_(), opacity.clamp(max=ALPHA_MAX))
        # threshold_ keeps what is greater: what is equal to the cutoff stays.
        cutoff = torch.nextafter(opacity.new_tensor(ALPHA_CUTOFF), opacity.new_tensor(0.0))
        torch.threshold_(alpha, cutoff.item(), 0)
        clear = 1 - alpha
        transmittance = alpha.new_empty(alpha.shape[0], alpha.shape[1] + 1, alpha.shape[2])
        transmittance[:, 0] = batch.transmittance
        for j in range(alpha.shape[1]):
            torch.mul(transmittance[:, j], clear[:, j], out=transmittance[:, j + 1])
        if transmittance[:, -1].min() <= TRANSMITTANCE_MIN:
            alpha.masked_fill_(transmittance[:, 1:] <= TRANSMITTANCE_MIN, 0)
        weights = alpha * transmittance[:, :-1]
        return Blended(ids, self.features[ids], alpha, clear, transmittance, weights)

    def add_gradients(
        self, grads: Gradients, blend: Blended, batch: Batch, grad_log_alpha: Tensor
    ) -> None:
        """Add this batch's share, from the moments of the gradient over each tile's pixels."""
        x, y = self._offsets(blend.ids, batch)
        xx, xy, yy = self.conics[blend.ids].unbind(-1)
        moments = grad_log_alpha @ monomials(grad_log_alpha).T
        total, u, v, uu, uv, vv = moments.unbind(-1)
        du, dv = u - x * total, v - y * total
        means = torch.stack([xx * du + xy * dv, xy * du + yy * dv], dim=-1)
        conics = torch.stack(
            [
                -0.5 * (uu - 2 * x * u + x * x * total),
                -(uv - x * v - y * u + x * y * total),
                -0.5 * (vv - 2 * y * v + y * y * total),
            ],
            dim=-1,
        )
        rows = blend.ids.flatten()
        grads.means.index_add_(0, rows, means.flatten(0, 1))
        grads.conics.index_add_(0, rows, conics.flatten(0, 1))
        floor = self.opacities[blend.ids].clamp(min=ALPHA_CUTOFF)
        grads.opacities.index_add_(0, rows, (total / floor).flatten())

    def add_absgrad(
        self, absgrad: Tensor, blend: Blended, batch: Batch, grad_log_alpha: Tensor
    ) -> None:
        """Add the sum over pixels of |d loss / d mean| to `absgrad`, [N, 2]."""
        x, y = self._offsets(blend.ids, batch)
        xx, xy, yy = self.conics[blend.ids].unbind(-1)
        linear = monomials(grad_log_alpha)[:3]
        for axis, (a, b) in enumerate(((xx, xy), (xy, yy))):
            slope = torch.stack([-(a * x + b * y), a, b], dim=-1) @ linear
            share = torch.linalg.vector_norm(slope.mul_(grad_log_alpha), ord=1, dim=-1)
            absgrad[:, axis].index_add_(0, blend.ids.flatten(), share.flatten())

    def _ids(self, batch: Batch) -> tuple[Int[Tensor, "B S"], Bool[Tensor, "B S"]]:
        """The Gaussians of a batch, and which of them are padding behind a list's end (False)."""
        listed = batch.steps < self.lists.counts[batch.tiles, None]
        place = self.lists.starts[batch.tiles, None] + batch.steps.where(listed, 0)
        return self.lists.gaussians[place], listed

    def _offsets(self, ids: Tensor, batch: Batch) -> tuple[Tensor, Tensor]:
        """Means relative to the tile's centre, pixels."""
        columns = self.lists.columns
        corner = torch.stack([batch.tiles % columns, batch.tiles // columns], dim=-1) * TILE
        x, y = (self.means[ids] - (corner + TILE / 2)[:, None]).unbind(-1)
        return x, y

    def _log_alpha_terms(self, ids: Tensor, batch: Batch, opacity: Tensor) -> Tensor:
        """log(opacity) - sigma as a polynomial in the pixel's place in the tile, [B, S, 6]."""
        x, y = self._offsets(ids, batch)
        xx, xy, yy = self.conics[ids].unbind(-1)
        # exp(-1e4) is 0 in every dtype, and unlike log(0) it survives a multiplication by 0.
        log_opacity = opacity.log().clamp(min=-1e4)
        constant = log_opacity - 0.5 * (xx * x * x + yy * y * y) - xy * x * y
        terms = [constant, xx * x + xy * y, xy * x + yy * y, -0.5 * xx, -xy, -0.5 * yy]
        return torch.stack(terms, dim=-1)


def monomials(like: Tensor) -> Float[Tensor, "6 P"]:
    """1, u, v, u^2, u v, v^2 at the pixel centres of a tile, from the tile's centre."""
    line = torch.arange(TILE, dtype=like.dtype, device=like.device) + (0.5 - TILE / 2)
    v, u = (t.flatten() for t in torch.meshgrid(line, line, indexing="ij"))
    return torch.stack([torch.ones_like(u), u, v, u * u, u * v, v * v])
