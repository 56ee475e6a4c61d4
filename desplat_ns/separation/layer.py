"""What a training step does with the distractors: draw, weigh, and, if it was finite, commit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import torch
from jaxtyping import Bool, Float
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.models.splatfacto import SplatfactoModelConfig
from torch import Tensor, nn
from torch.optim import Optimizer

from desplat_ns.backend.protocol import Rendering, Splats, View
from desplat_ns.console import announce
from desplat_ns.gaussians.activation import (
    RawParameters,
    activate_distractors,
    keep_colors_in_range,
)
from desplat_ns.gaussians.densification import DistractorDensifier, strategy_info
from desplat_ns.gaussians.distractor_config import DistractorConfig, rates_at
from desplat_ns.gaussians.distractors import DistractorGaussians, ViewDistractors
from desplat_ns.gaussians.memory import GaussianMemory
from desplat_ns.rendering.layers import layered_outputs
from desplat_ns.separation.clearance import Clearance
from desplat_ns.separation.grid import region_pixels
from desplat_ns.separation.own_sky import own_sky
from desplat_ns.separation.placement import (
    FEW_VIEWS,
    about_few_views,
    distractor_weight,
    placement,
)
from desplat_ns.separation.regions import StaticView, apply_mask, compare, find_regions
from desplat_ns.separation.residuals import LEAST_VIEWS, ResidualStats
from desplat_ns.separation.witness import Witnesses
from desplat_ns.settings.effects import BackgroundGrade
from desplat_ns.training.losses import (
    distractor_opacity_loss,
    layered_photometric_losses,
    photometric_loss,
    static_transparency_loss,
)

STOP_PLACING_AT = 27_000
"""Nominal step from which none is placed or removed for its place any more."""

LOOK_EVERY = 3
"""In one round of visits in this number the photos are compared with the static scene."""


@dataclass(repr=False)
class TrainStep:
    """One training view in one training step, from its rendering to the optimizers' step.

    It is made when the view is drawn and filled in when the loss is computed. Nothing that it holds
    has an effect beyond the step until it is committed: a step that is not finite is undone by
    throwing it away.
    """

    number: int
    index: int
    """Number of the training view."""
    view: View
    static: Rendering
    """The static scene."""
    distractors: Rendering | None = None
    """The view's own distractors; None if none were drawn."""

    photo: Float[Tensor, "H W 3"] = field(init=False)
    """What the view should look like, in [0, 1]; under the user's mask as the static scene."""
    static_rgb: Float[Tensor, "H W 3"] = field(init=False)
    """The static scene as an image, over the background."""
    composite: Float[Tensor, "H W 3"] = field(init=False)
    """The distractors over it."""
    alpha_d: Float[Tensor, "H W 1"] = field(init=False)
    """Opacity of the distractors."""

    regions: Bool[Tensor, "rows columns"] | None = None
    """Where distractors belong, on the grid of `grid_of`; None in the warm-up."""
    residual_stats: ResidualStats | None = None
    """What the static Gaussians are to remember, with this view; None for nothing."""
    witness: Float[Tensor, "3 rows columns"] | None = None
    """What is to be kept of the photo, for when other photos are asked; None for nothing."""


class DistractorLayer:
    """All that the distractors need besides themselves, which the model holds."""

    def __init__(
        self,
        gaussians: DistractorGaussians,
        config: DistractorConfig,
        static: SplatfactoModelConfig,
        cameras: Cameras,
        points: Float[Tensor, "P 3"] | None,
        background: BackgroundGrade = "off",
        scale: float = 1.0,
    ):
        """Says so where there are too few views to judge by.

        Args:
            gaussians: the distractors of all views.
            config: of the distractors; steps as they are in this run.
            static: of the static scene; both sets share thresholds.
            cameras: the training cameras, shape [V].
            points: of the reconstruction, if the scene starts from them.
            background: what lies behind the scene.
            scale: steps of the run for each nominal one.
        """
        self.gaussians = gaussians
        self.config = config
        self.static = static
        self.num_views = len(cameras)
        self.background = background
        every = config.steps_between_refinements(self.num_views, scale)
        self.densifier = DistractorDensifier(config, static, every)
        self.rates_at: Callable[[int], Mapping[str, float]] = rates_at
        self.clearance = Clearance(config.clearance, points, cameras)
        self.witnesses = Witnesses(points, cameras)
        self.regions: dict[int, Bool[Tensor, "rows columns"]] = {}
        """Those of each view, as it was last looked at."""
        if config.start == "residual" and self.num_views < FEW_VIEWS:
            announce(about_few_views(self.num_views), warning=True)

    def draw(self, index: int, rasterize: Callable[[Splats], Rendering]) -> Rendering | None:
        """Render the distractors of training view `index`; None if it has none."""
        view = self.gaussians.views[index]
        return rasterize(activate_distractors(view.params)) if len(view) > 0 else None

    def draw_for_training(
        self, step: int, index: int, rasterize: Callable[[Splats], Rendering]
    ) -> Rendering | None:
        """As `draw`, with what densification needs to be told; None in the warm-up."""
        if step < self.config.static_warmup:
            return None
        self.gaussians.views[index].begin_step(self.rates_at(step))
        rendering = self.draw(index, rasterize)
        if rendering is not None:
            self.densifier.before_backward(rendering)
        return rendering

    def optimizers_of(self, train_step: TrainStep) -> dict[str, Optimizer]:
        """Those of the view's distractors, by the names of their groups; none if none is drawn."""
        if train_step.distractors is None:
            return {}
        optimizers = self.gaussians.views[train_step.index].optimizers
        return {f"distractor_{name}": optimizer for name, optimizer in optimizers.items()}

    def training_outputs(
        self, train_step: TrainStep, image: Float[Tensor, "H W 3"], rgb: Float[Tensor, "H W 3"]
    ) -> dict[str, Tensor]:
        """The layers and the composite of a step.

        With `static_alone` the composite's loss moves distractors only: what lies beneath them is a
        constant.

        Args:
            image: of the static scene; colours may be beyond 1.
            rgb: the same in [0, 1].
        """
        alone = self.config.static_alone and train_step.distractors is not None
        return layered_outputs(image.detach() if alone else image, rgb, train_step.distractors)

    def losses(
        self,
        train_step: TrainStep,
        alpha_s: Float[Tensor, "H W 1"],
        opacities: Float[Tensor, "N 1"],
        memory: GaussianMemory,
        mask: Bool[Tensor, "H W 1"] | None,
    ) -> dict[str, Tensor]:
        """The opacity terms of Eq. 5; with `static_alone` also the photometric ones, of the
        composite and of the static scene by itself.

        Args:
            alpha_s: opacity of the static scene.
            opacities: of the static Gaussians, logits.
            memory: what they remember; it is read only.
            mask: the user's, False in pixels that do not count; None if there is none.
        """
        config, counted = self.config, None
        if mask is not None:
            train_step.photo, counted = apply_mask(train_step.photo, train_step.static_rgb, mask)
        train_step.regions = self.regions.get(train_step.index)
        if self._looks(train_step):
            self.update_regions(train_step, opacities, memory, counted)
        regions, alpha_d = train_step.regions, train_step.alpha_d
        if train_step.distractors is None:
            losses = {"distractor_opacity": alpha_d.new_zeros(())}
            return losses | self._transparency_loss(alpha_s, None)
        in_region = None
        if regions is not None:
            in_region = region_pixels(regions.to(alpha_d.dtype), *alpha_d.shape[:2])
        opacity = distractor_opacity_loss(alpha_d, in_region)
        losses = {"distractor_opacity": config.lambda_d * opacity}
        owned = distractor_weight(alpha_d, in_region) if config.static_alone else None
        if owned is not None:
            leak = config.leak if train_step.number < self.static.stop_split_at else 0.0
            losses |= self._photometric_losses(train_step, owned, leak, mask)
        return losses | self._transparency_loss(alpha_s, owned)

    def _transparency_loss(
        self, alpha_s: Float[Tensor, "H W 1"], owned: Float[Tensor, "H W 1"] | None
    ) -> dict[str, Tensor]:
        """The static term of Eq. 5: everywhere without a background. Before one the scene may be
        empty (App. B.3), but not in what distractors own, where no photo says so; with a background
        of each photo's own that has cost more than it gained.

        Args:
            owned: by the distractors; None if nothing is left to them alone.
        """
        if self.background == "off":
            where = None
        elif self.background == "image" or owned is None:
            return {}
        else:
            where = owned
        transparency = static_transparency_loss(alpha_s, where)
        return {"static_transparency": self.config.lambda_s * transparency}

    def _photometric_losses(
        self,
        train_step: TrainStep,
        owned: Float[Tensor, "H W 1"],
        leak: float,
        mask: Tensor | None,
    ) -> dict[str, Tensor]:
        """L_GS of the composite, and of the static scene on what is not owned; in masked pixels the
        composite shows the static scene, as the photo does."""
        static, composite, photo = train_step.static_rgb, train_step.composite, train_step.photo
        weight = self.static.ssim_lambda
        if mask is not None:
            composite = torch.where(mask, composite, static.detach())
        if self.static.use_bilateral_grid:  # the composite moves the grids everywhere
            own = photometric_loss(static, photo, weight, owned, leak)
            main = photometric_loss(composite, photo, weight)
        else:
            own, main = layered_photometric_losses(static, composite, photo, weight, owned, leak)
        return {"main_loss": main, "static_photometric": own}

    def _looks(self, train_step: TrainStep) -> bool:
        """Whether the photo is compared with the static scene: in the warm-up, once after it, and
        in every `LOOK_EVERY`th round of visits."""
        if self.config.start != "residual" or self.num_views <= LEAST_VIEWS:
            return False
        is_due = train_step.number // self.num_views % LOOK_EVERY == 0
        is_new = train_step.index not in self.regions
        return is_due or is_new or train_step.number < self.config.static_warmup

    @torch.no_grad()
    def update_regions(
        self,
        train_step: TrainStep,
        opacities: Float[Tensor, "N 1"],
        memory: GaussianMemory,
        counted: Bool[Tensor, "rows columns"] | None,
    ) -> None:
        """Find the regions of a step, and the statistics with it; in the warm-up these alone.

        Args:
            opacities: of the static Gaussians, logits.
            memory: what they remember; it is read only.
            counted: cells that the user's mask leaves in; None if it leaves out none.
        """
        photo = train_step.photo
        static = StaticView(
            train_step.static_rgb.detach(),
            train_step.static.means2d.detach()[0],
            train_step.static.visible,
            torch.sigmoid(opacities.detach()[:, 0]),
        )
        stats = ResidualStats.of(memory, len(opacities), self.num_views, photo.device)
        judged = counted
        if self.background == "image":
            scene = ~own_sky(photo, train_step.static.alpha)
            judged = scene if counted is None else scene & counted
        comparison, train_step.residual_stats = compare(photo, static, stats, judged)
        if train_step.number < self.config.static_warmup:
            train_step.witness = comparison.photo
            return
        comparison = replace(comparison, counted=counted)  # skies within a thing's outline are it
        train_step.regions = find_regions(
            comparison, self.config, lambda: self.witnesses.unexplained(train_step.index)
        )

    def commit(
        self,
        train_step: TrainStep,
        params: nn.ParameterDict,
        memory: GaussianMemory,
        refine_static: Callable[[], None],
        weights_of: Callable[[RawParameters], Float[Tensor, " M"]],
    ) -> None:
        """Take up what a step proposes, once the optimizers have stepped: here alone anything that
        outlives a step is changed.

        Args:
            params: of the static Gaussians, raw.
            memory: what they remember.
            refine_static: refines the static set; called once it has what belongs to its rows.
            weights_of: gives what each of the view's distractors makes up of it, in pixels.
        """
        index, view, static = train_step.index, train_step.view, train_step.static
        if train_step.residual_stats is not None:
            train_step.residual_stats.keep_in(memory)
        if train_step.witness is not None:
            self.witnesses.keep(index, train_step.witness)
        self.clearance.hide_near_camera(
            index, view, params["means"], params["opacities"].data, static.visible
        )
        refine_static()
        distractors, step = self.gaussians.views[index], train_step.number
        before = len(distractors)
        if train_step.distractors is not None:
            keep_colors_in_range(distractors.params)
            info = strategy_info(train_step.distractors, view)
            self.densifier.after_step(distractors, step, info, weights_of)
        if train_step.regions is not None and train_step.residual_stats is not None:
            self.regions[index] = train_step.regions
            if step < STOP_PLACING_AT:
                self._place(train_step, train_step.regions, distractors)
        self.gaussians.total += len(distractors) - before

    @torch.no_grad()
    def _place(self, train_step: TrainStep, regions: Tensor, distractors: ViewDistractors) -> None:
        """Give the view new distractors where they belong, and remove those out of place."""
        means = distractors.params["means"]
        changed = placement(
            train_step.view, train_step.photo, train_step.alpha_d, regions, means, self.config
        )
        if changed is not None:
            distractors.exchange(*changed)
