"""Adaptive density control of the distractors: gsplat's DefaultStrategy for each view's set, whose
opacity is never reset (App. A)."""

from collections.abc import Callable
from typing import Any

from gsplat.strategy import DefaultStrategy
from jaxtyping import Float
from nerfstudio.models.splatfacto import SplatfactoModelConfig
from torch import Tensor

from desplat_ns.backend.protocol import Rendering
from desplat_ns.core.schedule import SPLATFACTOS_INTERVAL, NominalStep
from desplat_ns.distractors.config import CULL_ALPHA, DEPTH, STOP_DENSIFY_AT, DistractorConfig
from desplat_ns.distractors.sets import ViewDistractors
from desplat_ns.gaussians.activation import RawParameters
from desplat_ns.gaussians.strategy import UNLIMITED, refine, sample

GROW_GRAD = 6.0
"""By pixels, distractors are cloned or split where a shift by one pixel changes the loss, summed
over all pixels, by more than this: in colours times pixels, whatever the size of the image.
Splatfacto's threshold is of the mean over the image."""

MIN_PIXELS = 1.0
"""By pixels, distractors that make up less of the image are pruned (`accumulated_weights`): where
opacity costs nothing, none gets faint."""


class DistractorDensifier:
    """Clones, splits and prunes the distractors of one view at a time.

    Every `every` steps refinement falls due for every view, and each has it when it is next seen.
    With `start` everywhere it goes by Splatfacto's rules and steps; with `residual` by what a
    distractor makes up of the image.
    """

    def __init__(self, config: DistractorConfig, static: SplatfactoModelConfig, every: int):
        """`config` has the warm-up of this run, `static` the thresholds that both sets share and
        the warm-up before any refinement; `every`: nominal steps between two refinements."""
        self.every = every
        self.start = max(static.warmup_length, config.warmup)
        self.by_pixels = config.start == "residual"
        grow = {"absgrad": static.use_absgrad, "grow_scale3d": static.densify_size_thresh}
        if self.by_pixels:
            self.strategy = DefaultStrategy(prune_opa=CULL_ALPHA, grow_grad2d=GROW_GRAD, **grow)
        else:
            self.strategy = DefaultStrategy(
                prune_opa=CULL_ALPHA,
                grow_grad2d=static.densify_grad_thresh,
                grow_scale2d=static.split_screen_size,
                prune_scale2d=static.cull_screen_size,
                prune_scale3d=static.cull_scale_thresh,
                refine_scale2d_stop_iter=static.stop_screen_size_at,
                reset_every=static.reset_alpha_every * SPLATFACTOS_INTERVAL or UNLIMITED,
                **grow,
            )

    def after_step(
        self,
        view: ViewDistractors,
        step: NominalStep,
        drawn: Rendering,
        weights_of: Callable[[RawParameters], Float[Tensor, " N"]],
    ) -> None:
        """Sample a step that drew `view`; refine its distractors if that is due, from
        `STOP_DENSIFY_AT` on by pruning alone.

        Args:
            drawn: the rendering of this view's distractors in this step.
            weights_of: gives what each makes up of the image, in pixels.
        """
        if step <= self.start:
            return
        densifying = step < STOP_DENSIFY_AT
        if densifying:
            sample(self.strategy, view.state, drawn, self.by_pixels)
        fallen_due = step // self.every
        if fallen_due <= max(view.refinement, self.start // self.every):
            return
        view.refinement = fallen_due
        view.state["scene_scale"] = DEPTH if self.by_pixels else 1.0
        if self.by_pixels:
            large = weights_of(view.params) >= MIN_PIXELS
            if not bool(large.all()):
                nothing = {name: value.data[:0] for name, value in view.params.items()}
                view.exchange(large.nonzero()[:, 0], nothing)
        by_step = 0 if self.by_pixels else step
        parts: Any = (view.params, view.optimizers, view.state, by_step)
        if densifying:
            refine(self.strategy, *parts)
        else:
            self.strategy._prune_gs(*parts)
