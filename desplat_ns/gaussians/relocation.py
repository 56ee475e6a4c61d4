"""Density control by relocation (3DGS as MCMC): faint Gaussians go where the scene is opaque.

Nothing is split or pruned. A Gaussian that has become faint moves onto one that is not, and the two
share its opacity and its size so that the picture changes as little as possible; the set grows in
the same way, up to its limit. Noise on the means lets Gaussians that are not yet opaque explore.

Source: Kheradmand et al., "3D Gaussian Splatting as Markov Chain Monte Carlo" (arXiv 2404.09591).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from gsplat.strategy.base import Strategy
from gsplat.strategy.ops import _multinomial_sample, _update_param_with_optimizer
from gsplat.utils import normalized_quat_to_rotmat
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.optim import Optimizer

from desplat_ns.gaussians.activation import RawParameters
from desplat_ns.gaussians.strategy import LAST, NEVER, crossed

MOST_SHARING = 51
"""Gaussians that may share the opacity of one in one relocation; more are treated as this many."""

GROWTH = 1.05
"""Factor by which the set grows at each relocation, until it is at its limit."""

FAINT, STEEPNESS = 0.005, 100.0
"""Opacity around which noise fades out, and how fast: sigmoid(-STEEPNESS (opacity - FAINT))."""


@dataclass
class RelocationConfig:
    """Settings of density control by relocation."""

    times: int = 100
    """Relocations from the first step to `stop_split_at`."""
    noise: float = 5e5
    """Noise on the means after each step, in learning rates of the means; 0 for none."""
    opacity_price: float = 0.01
    """Weight of the mean opacity in the loss: what nothing needs becomes faint, and can move."""
    scale_price: float = 0.01
    """Weight of the mean scale, in scene units."""

    def price(self, params: RawParameters) -> Float[Tensor, ""]:
        """The regularizer of the set, of raw parameters. Source: Sec. 3.4."""
        opacity, scale = params["opacities"].sigmoid().mean(), params["scales"].exp().mean()
        return self.opacity_price * opacity + self.scale_price * scale


def shared_opacity(
    opacities: Float[Tensor, " N"], sharing: Int[Tensor, " N"]
) -> Float[Tensor, " N"]:
    """Opacity of each of `sharing` Gaussians in one place that cover what one alone covered.

    1 - (1 - o)^(1/n): n of them over one another let as much light through as the one did.

    Source: Eq. 9, first line.
    """
    return -torch.expm1(torch.log1p(-opacities) / sharing)


def shared_scale(opacities: Float[Tensor, " N"], sharing: Int[Tensor, " N"]) -> Float[Tensor, " N"]:
    """Factor on the scales of `sharing` Gaussians in one place, so that they cover what one did.

    With p their opacity, n of them along a line through the centre cover 1 - (1 - p exp(-x^2))^n,
    whose integral in units of that of exp(-x^2) is sum_k C(n, k) (-1)^(k-1) p^k / sqrt(k); it is to
    be o. That is Eq. 9's double sum, added up over its outer index.

    Args:
        opacities: o, of the one alone, in (0, 1).
        sharing: n, 1 to `MOST_SHARING`.
    """
    n, k = sharing.double()[:, None], torch.arange(1, MOST_SHARING + 1).to(opacities).double()
    p = shared_opacity(opacities.double(), sharing)[:, None]
    # log C(n, k); the terms beyond k = n, where C is 0, are masked
    log_choose = torch.lgamma(n + 1) - torch.lgamma(k + 1) - torch.lgamma((n - k).clamp_min(0) + 1)
    terms = torch.exp(log_choose + k * p.log()) / k.sqrt() * torch.where(k % 2 == 1, 1.0, -1.0)
    covered = torch.where(k <= n, terms, 0.0).sum(dim=1)
    return (opacities / covered).to(opacities.dtype)


@dataclass
class RelocatingStrategy(Strategy):
    """Relocates and adds Gaussians every `refine_every` steps; adds noise after every step."""

    config: RelocationConfig
    refine_every: int
    """Steps."""
    refine_start_iter: int
    refine_stop_iter: int
    most: int = NEVER
    """Gaussians beyond which the set does not grow."""
    prune_opa: float = 0.005
    """Opacity up to which a Gaussian is moved."""
    absgrad: bool = False
    """For what asks a strategy whether to gather absolute gradients: this one reads none."""

    def initialize_state(self, scene_scale: float = 1.0) -> dict[str, Any]:
        """Nothing is gathered; what others remember of each Gaussian may be added."""
        return {}

    def step_pre_backward(self, *_: Any, **__: Any) -> None:
        """Nothing: no gradient is read."""

    @torch.no_grad()
    def step_post_backward(
        self,
        params: nn.ParameterDict,
        optimizers: Mapping[str, Optimizer],
        state: dict[str, Any],
        step: int,
        info: dict[str, Any],
        packed: bool = False,
    ) -> None:
        """After an optimizer step: relocate and add if that is due, then noise.

        Args:
            params: raw parameters of the set.
            optimizers: by the same names.
            state: tensors with a row for each Gaussian follow it.
        """
        is_due = crossed(state, step, self.refine_every)
        if self.refine_start_iter < step < self.refine_stop_iter and is_due:
            self._relocate(params, optimizers, state)
            self._grow(params, optimizers, state)
        state[LAST] = step
        if self.config.noise > 0:
            rate = optimizers["means"].param_groups[0]["lr"]
            params["means"].add_(position_noise(params) * (rate * self.config.noise))

    def _relocate(self, params: Any, optimizers: Any, state: dict[str, Any]) -> None:
        """Move every faint Gaussian onto one that is not, chosen by opacity."""
        opacities = params["opacities"].flatten().sigmoid()
        faint = opacities <= self.prune_opa
        if not bool(faint.any()) or bool(faint.all()):
            return
        source = _sample(opacities.masked_fill(faint, 0.0), int(faint.sum()))
        self._copy(params, optimizers, state, source, faint)

    def _grow(self, params: Any, optimizers: Any, state: dict[str, Any]) -> None:
        """Add Gaussians onto others, chosen by opacity."""
        count = len(params["means"])
        more = min(self.most, int(GROWTH * count)) - count
        if more > 0:
            source = _sample(params["opacities"].flatten().sigmoid(), more)
            self._copy(params, optimizers, state, source, None)

    def _copy(
        self,
        params: Any,
        optimizers: Any,
        state: dict[str, Any],
        source: Int[Tensor, " M"],
        onto: Bool[Tensor, " N"] | None,
    ) -> None:
        """Let each source share its place with its copies, which take the rows `onto` or new ones.

        Adam's moments begin at zero in all of them. gsplat's ops do the same, but compute the
        shares on a GPU only, and forget what is remembered of the sources.
        """
        count = len(params["means"])
        sharing = (torch.bincount(source, minlength=count) + 1).clamp(max=MOST_SHARING)
        raw = params["opacities"].data
        opacities = raw.flatten().sigmoid().clamp(max=1 - torch.finfo(raw.dtype).eps)
        parents = source.unique()
        shares = sharing[parents]
        opacity = shared_opacity(opacities[parents], shares).clamp_min(self.prune_opa)
        narrower = shared_scale(opacities[parents], shares).log()[:, None]

        def rows(value: Tensor, copied: Tensor) -> Tensor:
            if onto is None:
                return torch.cat([value, copied])
            value[onto] = copied
            return value

        def changed(name: str, value: Tensor) -> nn.Parameter:
            value = value.detach()
            if name == "opacities":
                value[parents] = opacity.logit().reshape(-1, *value.shape[1:])
            elif name == "scales":
                value[parents] += narrower
            return nn.Parameter(rows(value, value[source]))

        def moments(_: str, value: Tensor) -> Tensor:
            value[parents] = 0
            return rows(value, value[source])

        _update_param_with_optimizer(changed, moments, params, optimizers)
        for key, value in state.items():
            if isinstance(value, Tensor):
                state[key] = rows(value.clone(), value[source])


def _sample(weights: Float[Tensor, " N"], count: int) -> Int[Tensor, " M"]:
    return _multinomial_sample(weights, count, replacement=True)


@torch.no_grad()
def position_noise(params: RawParameters) -> Float[Tensor, "N 3"]:
    """Noise for the means, as wide as each Gaussian's covariance and none where it is opaque.

    Source: Eq. 8 and the text below it.
    """
    opacities = params["opacities"].flatten().sigmoid()
    axes = normalized_quat_to_rotmat(nn.functional.normalize(params["quats"], dim=-1))
    free = torch.sigmoid(-STEEPNESS * (opacities - FAINT))
    noise = torch.randn_like(params["means"]) * free[:, None]
    along = torch.einsum("nij,ni->nj", axes, noise) * params["scales"].exp().square()
    return torch.einsum("nij,nj->ni", axes, along)
