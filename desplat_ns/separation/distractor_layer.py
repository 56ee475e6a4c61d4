"""What a training step does with the distractors: draw, weigh, refine, place and watch them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from jaxtyping import Bool, Float
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.models.splatfacto import SplatfactoModelConfig
from torch import Tensor, nn
from torch.optim import Optimizer

from desplat_ns.backend.protocol import Rendering, Splats
from desplat_ns.gaussians.activation import activate_distractors
from desplat_ns.gaussians.densification import DistractorDensifier, strategy_info
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import DistractorGaussians
from desplat_ns.gaussians.memory import GaussianMemory
from desplat_ns.rendering.layers import layered_outputs
from desplat_ns.separation.clearance import Clearance
from desplat_ns.separation.failure_cases import SeparationWatch, sight_of
from desplat_ns.separation.ownership import owned_share
from desplat_ns.separation.placement import Placement
from desplat_ns.separation.visit import Visit
from desplat_ns.training.losses import (
    distractor_opacity_loss,
    static_photometric_loss,
    static_transparency_loss,
)


class DistractorLayer:
    """All that the distractors need besides their parameters, which the model holds."""

    def __init__(
        self,
        gaussians: DistractorGaussians,
        config: DistractorConfig,
        static: SplatfactoModelConfig,
        cameras: Cameras,
        points: Float[Tensor, "P 3"] | None,
        names: Sequence[str],
    ):
        """Args:
        gaussians: the distractors of all views.
        config: of the distractors; steps as they are in this run.
        static: of the static scene; both sets share thresholds.
        cameras: the training cameras, shape [V].
        points: of the reconstruction, if the scene starts from them.
        names: of the training photos; may be empty.
        """
        self.gaussians = gaussians
        self.config = config
        self.ssim_weight = static.ssim_lambda
        num_views = len(cameras)
        self.densifier = DistractorDensifier(config, static, num_views)
        self.placement = Placement(config, num_views)
        self.clearance = Clearance(config.clearance, points, cameras)
        self.watch = SeparationWatch(config, names, num_views)

    def draw(self, index: int, rasterize: Callable[[Splats], Rendering]) -> Rendering | None:
        """Render the distractors of training view `index`; None if it has none."""
        if self.gaussians.count_of(index) == 0:
            return None
        return rasterize(activate_distractors(self.gaussians.params_of(index)))

    def draw_for_training(
        self, step: int, index: int, rasterize: Callable[[Splats], Rendering]
    ) -> Rendering | None:
        """As `draw`, with what densification needs to be told; None in the warm-up."""
        if step < self.config.static_warmup:
            return None
        rendering = self.draw(index, rasterize)
        if rendering is not None:
            self.gaussians.draws(index)
            self.densifier.before_backward(rendering)
        return rendering

    def training_outputs(self, visit: Visit, image: Float[Tensor, "H W 3"]) -> dict[str, Tensor]:
        """The layers and the composite of a visit.

        With `static_alone` the composite's loss moves distractors only: what lies beneath them is a
        constant.

        Args:
            image: of the static scene; colours may be beyond 1.
        """
        alone = self.config.static_alone and visit.distractors is not None
        return layered_outputs(image.detach() if alone else image, visit.distractors)

    def losses(
        self,
        step: int,
        visit: Visit,
        alpha_s: Float[Tensor, "H W 1"],
        opacities: Float[Tensor, "N 1"],
        memory: GaussianMemory,
        mask: Bool[Tensor, "H W 1"] | None,
    ) -> dict[str, Tensor]:
        """The opacity terms of Eq. 5; with `static_alone` also the static scene's own term.

        Args:
            alpha_s: opacity of the static scene.
            opacities: of the static Gaussians, logits.
            memory: what they remember; it is read only.
            mask: the user's, False in pixels that do not count; None if there is none.
        """
        config, free = self.config, None
        visit.mask = mask
        if step >= config.static_warmup:
            visit.sight = sight_of(visit.view, visit.alpha_d)
        if config.start == "residual":
            free = self.placement.look(step, visit, opacities, memory)
        losses = {
            "distractor_opacity": config.lambda_d * distractor_opacity_loss(visit.alpha_d, free),
            "static_transparency": config.lambda_s * static_transparency_loss(alpha_s),
        }
        if config.static_alone and visit.distractors is not None:
            owned = owned_share(visit.alpha_d, visit.left_out)
            if mask is not None:
                owned = owned.masked_fill(~mask, 1.0)
            losses["static_photometric"] = static_photometric_loss(
                visit.static_rgb, visit.photo, owned, self.ssim_weight
            )
        return losses

    def before_refinement(
        self,
        visit: Visit,
        means: Float[Tensor, "N 3"],
        opacities: Float[Tensor, "N 1"],
        memory: GaussianMemory,
    ) -> None:
        """Take up what a sound visit proposes, before the static set is refined.

        Args:
            means: of the static Gaussians.
            opacities: logits, which are written into.
            memory: what they remember.
        """
        if visit.learned is not None:
            visit.learned.keep_in(memory)
            self.placement.keep(visit)
        if visit.sight is not None:
            self.watch.see(visit.index, visit.sight)
        self.clearance.keep(visit.index, visit.view, means, opacities, visit.static.visible)

    def after_step(
        self,
        step: int,
        visit: Visit,
        means: Float[Tensor, "N 3"],
        optimizers: dict[str, Optimizer],
        pixels_of: Callable[[nn.ParameterDict], Float[Tensor, " M"]],
    ) -> None:
        """Refine and place the view's distractors after an optimizer step.

        Args:
            means: of the static Gaussians, refined.
            optimizers: nerfstudio's, by group name.
            pixels_of: gives the contribution of distractors to the view, in pixels.
        """
        if visit.distractors is not None:
            self.gaussians.keep_colors_in_range(visit.index)
            info = strategy_info(visit.distractors, visit.view)
            self.densifier.after_step(
                self.gaussians, visit.index, optimizers, step, info, pixels_of
            )
        self.placement.place(visit, self.gaussians, self.densifier, optimizers)
        self.gaussians.recount(visit.index)
        self.watch.look(step, means)

    def state_dict(self) -> dict[str, Any]:
        """The densifier's running statistics and what was found so far, for a checkpoint."""
        return self.densifier.state_dict() | self.placement.state_dict()

    def load_state_dict(self, state: dict[str, Any], device: torch.device) -> None:
        """Take up what `state_dict` gave, on `device`."""
        self.densifier.load_state_dict(state, device)
        self.placement.load_state_dict(state, device)
