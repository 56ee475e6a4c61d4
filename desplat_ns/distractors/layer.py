"""What a training step does with the distractors: draw, weigh, and, if it was finite, commit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from jaxtyping import Bool, Float, UInt8
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.models.splatfacto import SplatfactoModelConfig
from torch import Tensor

from desplat_ns.backend.protocol import Rendering, Splats, View
from desplat_ns.core.console import announce_once
from desplat_ns.core.effects import BackgroundGrade
from desplat_ns.core.schedule import NominalStep, RunStep
from desplat_ns.distractors.config import DistractorConfig, rates_at
from desplat_ns.distractors.placement import FEW_VIEWS, LEAST_VIEWS, about_few_views, placement
from desplat_ns.distractors.refinement import DistractorDensifier, strategy_info
from desplat_ns.distractors.sets import DistractorGaussians, ViewDistractors
from desplat_ns.gaussians.activation import (
    RawParameters,
    activate_distractors,
    keep_colors_in_range,
    sigmoid,
)
from desplat_ns.separation.decide import (
    StaticView,
    Thresholds,
    compare,
    decide,
    own_sky,
)
from desplat_ns.separation.grid import grid_of, pooled, region_pixels
from desplat_ns.separation.residuals import RESIDUAL_MEDIANS, medians_in
from desplat_ns.separation.sweep import PlaneSweep, photo_to_sweep

STOP_PLACING_AT = 27_000
"""Nominal step from which none is placed or removed for its place any more."""

LOOK_EVERY = 3
"""In one round of visits in this number the photos are compared with the static scene."""


@dataclass(repr=False)
class Step:
    """One training view in one training step: drawn, compared, charged, and committed or not.

    Whatever a step finds lies here until it is committed, and changes nothing before: a step that
    is not finite is undone by throwing it away.
    """

    nominal: NominalStep
    run: RunStep
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

    regions: Bool[Tensor, "rows columns"] | None = None
    """Where distractors belong, on the grid of `grid_of`; None in the warm-up."""
    residual_medians: Float[Tensor, " N"] | None = None
    """What the static Gaussians are to remember (`medians_in`); None for nothing new."""
    sweep_photo: UInt8[Tensor, "fine_rows fine_columns C"] | None = None
    """What the plane sweep is to keep of the photo (`photo_to_sweep`); None for nothing new."""

    losses: dict[str, Float[Tensor, ""]] = field(default_factory=dict)
    """The terms of the loss, without gradients."""


def apply_mask(
    photo: Float[Tensor, "H W 3"], static: Float[Tensor, "H W 3"], mask: Bool[Tensor, "H W 1"]
) -> tuple[Float[Tensor, "H W 3"], Bool[Tensor, "rows columns"]]:
    """What the user's mask does: where it leaves a photo out, the photo is as the static scene.

    Args:
        static: a constant from here on.
        mask: True in the pixels that count.

    Returns:
        The photo, and the cells of `grid_of` that count.
    """
    height, width = mask.shape[:2]
    counts = pooled(mask.to(torch.float32), grid_of(width, height))[0] >= 0.5
    return torch.where(mask, photo, static.detach()), counts


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
        self.num_views = len(cameras)
        self.background = background
        self.is_behind_by_chance = background == "off" and static.background_color == "random"
        """A sky, and a colour that the user chose, are part of the scene."""
        every = config.steps_between_refinements(self.num_views, scale)
        self.densifier = DistractorDensifier(config, static, every)
        self.thresholds = Thresholds(config.weak_excess, config.strong_excess)
        self.sweep = PlaneSweep(points, cameras)
        self.regions: dict[int, Bool[Tensor, "rows columns"]] = {}
        """Those of each view, as it was last looked at."""
        if config.start == "residual" and self.num_views < FEW_VIEWS:
            announce_once(about_few_views(self.num_views), warning=True)

    def draw(self, index: int, rasterize: Callable[[Splats], Rendering]) -> Rendering | None:
        """Render the distractors of training view `index`; None if it has none."""
        view = self.gaussians.views[index]
        return rasterize(activate_distractors(view.params)) if len(view) > 0 else None

    def draw_for_training(
        self, step: NominalStep, index: int, rasterize: Callable[[Splats], Rendering]
    ) -> Rendering | None:
        """As `draw`, with the gradients that densification reads; None in the warm-up."""
        if step < self.config.warmup:
            return None
        self.gaussians.views[index].begin_step(rates_at(step))
        rendering = self.draw(index, rasterize)
        if rendering is not None:
            rendering.means2d.retain_grad()
        return rendering

    def look(
        self,
        step: Step,
        photo: Float[Tensor, "H W 3"],
        static: Float[Tensor, "H W 3"],
        behind: Float[Tensor, "*background 3"] | None,
        mask: Bool[Tensor, "H W 1"] | None,
        opacities: Float[Tensor, "N 1"],
        state: Mapping[str, Any],
    ) -> tuple[Float[Tensor, "H W 3"], Float[Tensor, "H W 1"] | None]:
        """Compare the photo of a step with the static scene, if that is due.

        Args:
            static: in the photo's light, in [0, 1].
            behind: the background, in the photo's light.
            mask: the user's, False in pixels that do not count; None if there is none.
            opacities: of the static Gaussians, logits.
            state: of their strategy; it is read only.

        Returns:
            The photo, under the mask as the static scene; and 1 in pixels of regions, if the view
            has distractors.
        """
        counted, photo_as_it_is = None, photo
        if mask is not None:
            photo, counted = apply_mask(photo, static, mask)
        step.photo, step.static_rgb = photo, static
        step.regions = self.regions.get(step.index)
        if self.looks(step):
            if step.index not in self.sweep.photos:
                step.sweep_photo = photo_to_sweep(photo_as_it_is, mask)
            behind = behind if self.is_behind_by_chance else None
            self.update_regions(step, behind, opacities, state, counted)
        if step.distractors is None or step.regions is None:
            return photo, None
        return photo, region_pixels(step.regions.to(photo.dtype), *photo.shape[:2])

    def looks(self, step: Step) -> bool:
        """Whether the photo is compared with the static scene: in the warm-up, once after it, and
        in every `LOOK_EVERY`th round of visits. nerfstudio draws each view once in a round."""
        if self.config.start != "residual" or self.num_views <= LEAST_VIEWS:
            return False
        is_due = step.run // self.num_views % LOOK_EVERY == 0
        is_new = step.index not in self.regions
        return is_due or is_new or step.nominal < self.config.warmup

    @torch.no_grad()
    def update_regions(
        self,
        step: Step,
        behind: Float[Tensor, "*background 3"] | None,
        opacities: Float[Tensor, "N 1"],
        state: Mapping[str, Any],
        counted: Bool[Tensor, "rows columns"] | None,
    ) -> None:
        """Find the regions of a step, and what the Gaussians remember; in the warm-up that alone.

        Args:
            behind: the background in the photo's light; None if it is scene.
            opacities: of the static Gaussians, logits.
            state: of their strategy; it is read only.
            counted: cells that the user's mask leaves in; None if it leaves out none.
        """
        photo = step.photo
        static = StaticView(
            step.static_rgb.detach(),
            step.static.alpha.detach(),
            None if behind is None else behind.detach(),
            step.static.means2d.detach()[0],
            step.static.visible,
            sigmoid(opacities.detach()[:, 0]),
        )
        residual_medians = medians_in(state, len(opacities), photo.device)
        judged = counted
        if self.background == "image":
            scene = ~own_sky(photo, step.static.alpha)
            judged = scene if counted is None else scene & counted
        comparison, step.residual_medians = compare(photo, static, residual_medians, judged)
        if step.nominal < self.config.warmup:
            return
        comparison = replace(comparison, counted=counted)  # skies within a thing's outline are it
        step.regions = decide(
            comparison,
            lambda: self.sweep.unexplained(step.index, photo.device),
            self.thresholds,
        )

    def remember(self, step: Step, state: dict[str, Any]) -> None:
        """Take up what a step learned of the views, once the optimizers have stepped and before the
        static set is refined, whose rows it belongs to. Before, all that a step does and that
        outlives it is to make the view's optimizers and set their rates.

        Args:
            state: of the static Gaussians' strategy.
        """
        if step.residual_medians is not None:
            state[RESIDUAL_MEDIANS] = step.residual_medians
        if step.sweep_photo is not None:
            self.sweep.keep(step.index, step.sweep_photo)

    def commit(
        self, step: Step, weights_of: Callable[[RawParameters], Float[Tensor, " M"]]
    ) -> None:
        """Refine the view's distractors, and place and remove some where a step found its regions.

        Args:
            weights_of: gives what each of the view's distractors makes up of it, in pixels.
        """
        index, view = step.index, step.view
        distractors = self.gaussians.views[index]
        if step.distractors is not None:
            keep_colors_in_range(distractors.params)
            info = strategy_info(step.distractors, view)
            self.densifier.after_step(distractors, step.nominal, info, weights_of)
        if step.regions is not None and step.residual_medians is not None:
            self.regions[index] = step.regions
            if step.nominal < STOP_PLACING_AT:
                self._place(step, step.regions, distractors)

    @torch.no_grad()
    def _place(self, step: Step, regions: Tensor, distractors: ViewDistractors) -> None:
        """Give the view new distractors where they belong, and remove those out of place."""
        means = distractors.params["means"]
        drawn, photo = step.distractors, step.photo
        alpha_d = torch.zeros_like(photo[..., :1]) if drawn is None else drawn.alpha.detach()
        changed = placement(step.view, photo, alpha_d, regions, means, self.config)
        if changed is not None:
            distractors.exchange(*changed)
