"""Adaptive density control of the distractors: gsplat's DefaultStrategy, for each view's set.

It differs from that of the static scene (`strategy.py`): there is a set for each view, opacity is
never reset (App. A), sizes are measured against the depth at which distractors start, and what
makes up too little of the photo is pruned.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gsplat
import torch
from gsplat.strategy import DefaultStrategy
from jaxtyping import Float, Int
from nerfstudio.models.splatfacto import SplatfactoModelConfig
from torch import Tensor, nn
from torch.optim import Optimizer

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import PARAMETER_NAMES, DistractorGaussians
from desplat_ns.gaussians.strategy import prune, refine, sample

RADII_PER_AXIS = tuple(int(part) for part in gsplat.__version__.split(".")[:2]) >= (1, 5)
"""gsplat 1.5 gives radii as [C, N, 2], 1.4 as [C, N]; each one's strategy takes only its own."""


def strategy_info(rendering: Rendering, view: View) -> dict[str, Any]:
    """A rendering as gsplat's DefaultStrategy reads it, in the shapes of the installed gsplat."""
    radii = rendering.radii[None]
    return {
        "means2d": rendering.means2d,
        "radii": radii[..., None].expand(-1, -1, 2) if RADII_PER_AXIS else radii,
        "width": view.width,
        "height": view.height,
        "n_cameras": 1,
        "gaussian_ids": None,
    }


class DistractorDensifier:
    """Clones, splits and prunes the distractors of one view at a time.

    Every `refine_every` steps refinement falls due: for the view that is drawn then or, with
    `refine_when_next_seen`, for every view when it is next seen, as nothing new is known of it
    until then. Adam's moments follow: rows that stay keep theirs, new rows start at zero.
    """

    def __init__(self, config: DistractorConfig, static: SplatfactoModelConfig, num_views: int):
        """Args:
        config: thresholds of the distractors; steps as they are in this run.
        static: the thresholds that both sets share, and the warm-up before any refinement.
        num_views: number of training views.
        """
        self.config = config
        self.schedule: Callable[[int], int | float] = lambda step: step
        """Where the thresholds are in a step; refinements are `refine_every` steps apart."""
        self.start = max(static.warmup_length, config.static_warmup)
        self.strategy = DefaultStrategy(
            prune_opa=config.cull_alpha_thresh,
            grow_grad2d=config.grow_grad or static.densify_grad_thresh,
            grow_scale3d=static.densify_size_thresh,
            absgrad=static.use_absgrad,
        )
        self.rounds = [self._round(self.start)] * num_views
        self.running = [
            self.strategy.initialize_state(scene_scale=config.depth) for _ in range(num_views)
        ]

    def _is_due(self, step: int, view: int) -> bool:
        """Whether `view`, which is drawn at `step`, is refined now."""
        if self.config.refine_when_next_seen:
            return self._round(step) > self.rounds[view]
        return step % self.config.refine_every == 0

    def _round(self, step: int) -> int:
        """How often refinement fell due until `step`."""
        return step // self.config.refine_every

    def before_backward(self, rendering: Rendering) -> None:
        """Keep the gradient of the projected means, which refinement reads."""
        self.strategy.step_pre_backward({}, {}, {}, 0, {"means2d": rendering.means2d})

    def after_step(
        self,
        distractors: DistractorGaussians,
        view: int,
        optimizers: dict[str, Optimizer],
        step: int,
        info: dict[str, Any],
        pixels_of: Callable[[nn.ParameterDict], Float[Tensor, " N"]],
    ) -> None:
        """Sample a visit of `view`; refine its distractors if that is due.

        Args:
            optimizers: nerfstudio's, by group name.
            step: training step; nothing happens before the warm-up, and from `stop_densify_at` on
                nothing but pruning, if that.
            info: of the rendering of this view's distractors in this step.
            pixels_of: gives the contribution of each, in pixels; called only where it is needed.
        """
        now = round(self.schedule(step))
        densifying = now < self.config.stop_densify_at
        if now <= self.start or not (densifying or self.config.cull_to_the_end):
            return
        if densifying:
            self._sample(distractors.params_of(view), self.running[view], info)
        if self._is_due(step, view):
            self.rounds[view] = self._round(step)
            self._prune_the_small(distractors, view, optimizers, pixels_of)
            self._refine(distractors.params_of(view), view, optimizers, densifying)

    def _prune_the_small(
        self,
        distractors: DistractorGaussians,
        view: int,
        optimizers: dict[str, Optimizer],
        pixels_of: Callable[[nn.ParameterDict], Float[Tensor, " N"]],
    ) -> None:
        """Remove distractors that make up less than `min_pixels`."""
        if self.config.min_pixels <= 0:
            return
        params = distractors.params_of(view)
        large = pixels_of(params) >= self.config.min_pixels
        if not bool(large.all()):
            nothing = {name: value.data[:0] for name, value in params.items()}
            self.exchange(distractors, view, optimizers, large.nonzero()[:, 0], nothing)

    def _refine(
        self,
        params: nn.ParameterDict,
        view: int,
        optimizers: dict[str, Optimizer],
        densifying: bool,
    ) -> None:
        """Clone, split and prune, or only prune."""
        borrowed = {
            name: _OneParameter(optimizers[f"distractor_{name}"], params[name])
            for name in PARAMETER_NAMES
        }
        if densifying:
            refine(self.strategy, params, borrowed, self.running[view])
        else:
            prune(self.strategy, params, borrowed, self.running[view])
        for name, one in borrowed.items():
            optimizers[f"distractor_{name}"].param_groups[0]["params"][view] = one.parameter

    def _sample(
        self, params: nn.ParameterDict, state: dict[str, Any], info: dict[str, Any]
    ) -> None:
        """Gather the gradients of a visit.

        With `grow_grad` those of the sum of the loss over all pixels by a shift of one pixel,
        which do not depend on the image's size. gsplat multiplies by half the width and height,
        and the loss is a mean over width times height.
        """
        if self.config.grow_grad > 0:
            twice_the_pixels = 2 * info["width"] * info["height"]
            info = info | {"width": twice_the_pixels, "height": twice_the_pixels}
        sample(self.strategy, params, state, info)

    @torch.no_grad()
    def exchange(
        self,
        distractors: DistractorGaussians,
        view: int,
        optimizers: dict[str, Optimizer],
        kept: Int[Tensor, " M"],
        new: dict[str, Tensor],
    ) -> None:
        """Remove the distractors of `view` but for those in `kept`, and add `new` ones.

        Args:
            optimizers: nerfstudio's, by group name.
            kept: numbers of rows, as a mask's number of rows would have to be waited for each time.
            new: raw parameters, by `PARAMETER_NAMES`; any number of rows.
        """

        def changed(old: Tensor, rows: Tensor | None = None) -> Tensor:
            rows = old.new_zeros(len(new["means"]), *old.shape[1:]) if rows is None else rows
            return torch.cat([old[kept], rows])

        params = distractors.params_of(view)
        for name in PARAMETER_NAMES:
            optimizer = optimizers[f"distractor_{name}"]
            old, params[name] = params[name], nn.Parameter(changed(params[name].data, new[name]))
            moments = optimizer.state.pop(old, {})
            if moments:
                optimizer.state[params[name]] = {
                    key: value if key == "step" else changed(value)
                    for key, value in moments.items()
                }
            optimizer.param_groups[0]["params"][view] = params[name]
        running = self.running[view]
        for key, value in running.items():
            if isinstance(value, Tensor):
                running[key] = changed(value)

    def state_dict(self) -> dict[str, Any]:
        """Number of refinements that fell due and running statistics, for a checkpoint."""
        return {"rounds": list(self.rounds), "running": [dict(state) for state in self.running]}

    def load_state_dict(self, state: dict[str, Any], device: torch.device) -> None:
        """Take up what `state_dict` gave, on `device`."""
        self.rounds = list(state["rounds"])
        self.running = [to_device(running, device) for running in state["running"]]


def to_device(state: dict[str, Any], device: torch.device) -> dict[str, Any]:
    """A strategy's running state with its tensors on `device`."""
    return {k: v.to(device) if isinstance(v, Tensor) else v for k, v in state.items()}


class _OneParameter:
    """What gsplat's strategies touch of an optimizer, for one parameter of a group of many.

    gsplat replaces the whole list of parameters of a group; here that list has one entry.
    """

    def __init__(self, optimizer: Optimizer, parameter: nn.Parameter):
        self.param_groups = [{"params": [parameter]}]
        self.state = optimizer.state

    @property
    def parameter(self) -> nn.Parameter:
        return self.param_groups[0]["params"][0]
