"""Adaptive density control of the static set: gsplat's, with its own sample and limit of growth.

An interval between refinements is no schedule but a sample, which must not shrink with the length
of a run (docs/explain/separation.md, "How often Gaussians are refined").
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
from gsplat.strategy import DefaultStrategy
from gsplat.strategy.ops import _update_param_with_optimizer as replace_rows
from gsplat.strategy.ops import duplicate, normalized_quat_to_rotmat, reset_opa, split
from jaxtyping import Bool
from torch import Tensor, nn

from desplat_ns.backend.protocol import Rendering
from desplat_ns.core.schedule import NominalStep

UNLIMITED = 2**62
"""A step that no training reaches, and a number of Gaussians that no set has."""

LAST = "last_step"
"""Key in a strategy's state: the step that it was called at before."""


def crossed(state: Mapping[str, Any], step: int, every: int) -> bool:
    """Whether a multiple of `every` was reached since the last call: schedules may pass over a
    nominal step, and those that go by time may stay at one."""
    return step // every > state.get(LAST, step - 1) // every


@torch.no_grad()
def sample(
    strategy: DefaultStrategy, state: dict[str, Any], drawn: Rendering, by_pixels: bool = False
) -> None:
    """Add the gradients of a visit to the statistics in `state`, by which `refine` judges: gsplat's
    `_update_state` for a single camera, which does not let the host wait for numbers of rows.

    The loss is a mean over width times height. gsplat multiplies its gradients by half the width
    and height, as of a shift by half the image. `by_pixels` they are of the loss summed over all
    pixels, by a shift of one pixel.
    """
    means2d: Any = drawn.means2d
    height, width = drawn.alpha.shape[:2]
    gradients = (means2d.absgrad if strategy.absgrad else means2d.grad)[0].clone()
    gradients[:, 0] *= width * height if by_pixels else width / 2
    gradients[:, 1] *= width * height if by_pixels else height / 2
    by_width = strategy.refine_scale2d_stop_iter > 0
    for name in ("grad2d", "count", *["radii"] * by_width):
        if state[name] is None:
            state[name] = gradients.new_zeros(len(gradients))
    state["grad2d"] += torch.where(drawn.visible, gradients.norm(dim=-1), 0.0)
    state["count"] += drawn.visible
    if by_width:
        widths = drawn.radii / float(max(width, height))
        state["radii"] = torch.maximum(state["radii"], torch.where(drawn.visible, widths, 0.0))


def refine(
    strategy: DefaultStrategy, params: Any, optimizers: Any, state: dict[str, Any], step: int
) -> None:
    """Clone, split and prune by the statistics in `state`, which are then set to zero."""
    strategy._grow_gs(params, optimizers, state, step)
    strategy._prune_gs(params, optimizers, state, step)
    for name in ("grad2d", "count", "radii"):
        if state.get(name) is not None:
            state[name].zero_()


@torch.no_grad()
def long_axis_split(
    params: Any, optimizers: Any, state: dict[str, Any], mask: Bool[Tensor, " N"]
) -> None:
    """Replace each Gaussian of `mask` by two of half its length, one behind the other along its
    longest axis, at sqrt(3) / 2 of its standard deviation from its centre: together they have its
    mass (opacity times volume), mean and covariance. gsplat's `split` draws two places at random,
    and what the Gaussian had learned is lost with its place."""
    chosen, rest = mask.nonzero().squeeze(-1), (~mask).nonzero().squeeze(-1)
    longest, axis = params["scales"][chosen].exp().max(dim=-1, keepdim=True)
    along = F.one_hot(axis.squeeze(-1), 3).to(longest)
    turned = normalized_quat_to_rotmat(F.normalize(params["quats"][chosen], dim=-1))
    offset = 0.75**0.5 * longest * (turned * along[:, None]).sum(dim=-1)
    changed = {
        "means": params["means"][chosen] + torch.stack([offset, -offset]),
        "scales": (params["scales"][chosen] - math.log(2) * along).expand(2, -1, -1),
    }

    def with_halves(name: str, value: Tensor) -> Tensor:
        halves = changed.get(name, value[chosen].expand(2, *[-1] * value.dim()))
        return nn.Parameter(torch.cat([value[rest], halves.flatten(0, 1)]))

    def with_zeros(name: str, moment: Tensor) -> Tensor:
        zeros = moment.new_zeros(2 * len(chosen), *moment.shape[1:])
        return torch.cat([moment[rest], zeros])

    replace_rows(with_halves, with_zeros, params, optimizers)
    for name, value in state.items():
        if isinstance(value, Tensor):
            state[name] = torch.cat([value[rest], value[chosen], value[chosen]])


@dataclass
class StaticStrategy(DefaultStrategy):
    """gsplat's DefaultStrategy for a run of any length on a capture of any size.

    Its settings are nominal steps but for `refine_every`: it refines when so many steps of the run
    were sampled. The `pause_refine_after_reset` steps after a reset of the opacities, in which the
    scene recovers, are not sampled; so the sample is the same however close resets are.
    """

    most: int = UNLIMITED
    """Gaussians beyond which the set does not grow."""
    long_axis_split: bool = False
    """Split by `long_axis_split` all that grow; none is cloned, nor split at random."""
    cull_to_the_end: bool = False
    """Prune after `refine_stop_iter` as well, every `refine_every` steps of the run: nerfstudio
    1.1.4 does, 1.1.5 does not."""

    SAMPLED = "steps_sampled"

    def after_step(
        self,
        params: Any,
        optimizers: Any,
        state: dict[str, Any],
        step: NominalStep,
        drawn: Rendering,
    ) -> None:
        """In place of gsplat's `step_post_backward`, after an optimizer step: add it to the sample,
        refine if that is complete, reset if due; rows of `optimizers` and `state` follow."""
        if step >= self.refine_stop_iter:
            state[self.SAMPLED] = state.get(self.SAMPLED, 0) + 1
            if self.cull_to_the_end and state[self.SAMPLED] >= self.refine_every:
                self._prune_gs(params, optimizers, state, step)
                state[self.SAMPLED] = 0
            return
        is_reset, since = step >= self.reset_every, step % self.reset_every
        if not (is_reset and since < self.pause_refine_after_reset):
            sample(self, state, drawn)
            state[self.SAMPLED] = state.get(self.SAMPLED, 0) + 1
        if step > self.refine_start_iter and state.get(self.SAMPLED, 0) >= self.refine_every:
            refine(self, params, optimizers, state, step)
            state[self.SAMPLED] = 0
        if crossed(state, step, self.reset_every):
            reset_opa(params, optimizers, state, value=self.prune_opa * 2.0)
        state[LAST] = step

    @torch.no_grad()
    def _grow_gs(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, params: Any, optimizers: Any, state: dict[str, Any], step: int
    ) -> None:
        """gsplat's, but where more would grow than there is room for, the smaller gradients have to
        wait. A clone or a split adds one; gsplat does both to a small one with a high gradient that
        is wide on the screen. `long_axis_split` clones none."""
        gradients: Tensor = state["grad2d"] / state["count"].clamp_min(1)
        steep = gradients > self.grow_grad2d
        small = params["scales"].exp().amax(dim=-1) <= self.grow_scale3d * state["scene_scale"]
        if self.long_axis_split:
            small = torch.zeros_like(steep)
        cloned, divided = steep & small, steep & ~small
        if step < self.refine_scale2d_stop_iter:
            divided |= state["radii"] > self.grow_scale2d
        added = cloned.long() + divided
        order = gradients.masked_fill(added == 0, -1.0).argsort(descending=True, stable=True)
        has_room = torch.empty_like(steep)
        has_room[order] = added[order].cumsum(dim=0) <= max(0, self.most - len(added))
        cloned, divided = cloned & has_room, divided & has_room
        if cloned.any():
            duplicate(params, optimizers, state, cloned)
        if divided.any():
            divided = F.pad(divided, (0, len(params["means"]) - len(divided)))
            halve = long_axis_split if self.long_axis_split else split
            halve(params, optimizers, state, divided)
