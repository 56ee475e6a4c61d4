"""Adaptive density control of the distractors: gsplat's DefaultStrategy, for each view's set.

It differs from that of the static scene (`strategy.py`): there is a set for each view, opacity is
never reset (App. A), sizes are measured against the depth at which distractors start, and what
makes up too little of the photo is pruned.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gsplat
from gsplat.strategy import DefaultStrategy
from jaxtyping import Float
from nerfstudio.models.splatfacto import SplatfactoModelConfig
from torch import Tensor

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.gaussians.activation import RawParameters
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import ViewDistractors
from desplat_ns.gaussians.strategy import LAST, crossed, prune, refine, sample

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

    def __init__(self, config: DistractorConfig, static: SplatfactoModelConfig):
        """Args:
        config: thresholds of the distractors, with the intervals of this run.
        static: the thresholds that both sets share, and the warm-up before any refinement.
        """
        self.config = config
        self.clock: dict[str, int] = {}
        """Of the steps that drew distractors, see `crossed`."""
        self.start = max(static.warmup_length, config.static_warmup)
        self.strategy = DefaultStrategy(
            prune_opa=config.cull_alpha_thresh,
            grow_grad2d=config.grow_grad or static.densify_grad_thresh,
            grow_scale3d=static.densify_size_thresh,
            absgrad=static.use_absgrad,
        )

    def _is_due(self, step: int, view: ViewDistractors) -> bool:
        """Whether `view`, which is drawn at `step`, is refined now."""
        if self.config.refine_when_next_seen:
            return self._fallen_due(step) > max(view.refinement, self._fallen_due(self.start))
        return crossed(self.clock, step, self.config.refine_every)

    def _fallen_due(self, step: int) -> int:
        """How many refinements have fallen due until `step`."""
        return step // self.config.refine_every

    def before_backward(self, rendering: Rendering) -> None:
        """Keep the gradient of the projected means, which refinement reads."""
        self.strategy.step_pre_backward({}, {}, {}, 0, {"means2d": rendering.means2d})

    def after_step(
        self,
        view: ViewDistractors,
        step: int,
        info: dict[str, Any],
        weights_of: Callable[[RawParameters], Float[Tensor, " N"]],
    ) -> None:
        """Sample a step that drew `view`; refine its distractors if that is due.

        Args:
            step: nominal; nothing happens before the warm-up, and nothing but
                pruning, if that, from `stop_densify_at` on.
            info: of the rendering of this view's distractors in this step.
            weights_of: gives what each makes up of the image, in pixels; called only where it
                is needed.
        """
        densifying = step < self.config.stop_densify_at
        if step <= self.start or not (densifying or self.config.cull_to_the_end):
            return
        if densifying:
            self._sample(view, info)
        if self._is_due(step, view):
            view.refinement = self._fallen_due(step)
            self._prune_the_small(view, weights_of)
            change = refine if densifying else prune
            change(self.strategy, view.params, view.optimizers, view.state)
        self.clock[LAST] = step

    def _prune_the_small(
        self,
        view: ViewDistractors,
        weights_of: Callable[[RawParameters], Float[Tensor, " N"]],
    ) -> None:
        """Remove distractors that make up less than `min_pixels`."""
        if self.config.min_pixels <= 0:
            return
        large = weights_of(view.params) >= self.config.min_pixels
        if not bool(large.all()):
            nothing = {name: value.data[:0] for name, value in view.params.items()}
            view.exchange(large.nonzero()[:, 0], nothing)

    def _sample(self, view: ViewDistractors, info: dict[str, Any]) -> None:
        """Gather the gradients of a step.

        With `grow_grad` those of the sum of the loss over all pixels by a shift of one pixel,
        which do not depend on the image's size. gsplat multiplies by half the width and height,
        and the loss is a mean over width times height.
        """
        if self.config.grow_grad > 0:
            twice_the_pixels = 2 * info["width"] * info["height"]
            info = info | {"width": twice_the_pixels, "height": twice_the_pixels}
        sample(self.strategy, view.params, view.state, info)
