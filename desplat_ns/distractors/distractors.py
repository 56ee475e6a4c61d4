"""The distractors of all training views, and what a training step does with them: look, and, if it
was finite, remember and commit."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from jaxtyping import Bool, Float
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.models.splatfacto import SplatfactoModelConfig
from torch import Tensor, nn

from desplat_ns.cameras.views import views_of
from desplat_ns.core.console import announce_once
from desplat_ns.core.devices import state_to_device
from desplat_ns.core.effects import BackgroundGrade
from desplat_ns.core.options import check_ranges
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.placement import FEW_VIEWS, LEAST_VIEWS, about_few_views, placement
from desplat_ns.distractors.refinement import DistractorDensifier
from desplat_ns.distractors.sets import ViewDistractors, fill_view
from desplat_ns.gaussians.activation import RawParameters, sigmoid
from desplat_ns.separation.decide import StaticView, Thresholds, compare, decide, own_sky
from desplat_ns.separation.grid import grid_of, pooled, region_pixels
from desplat_ns.separation.residuals import RESIDUAL_MEDIANS, medians_in
from desplat_ns.separation.sweep import PlaneSweep, photo_to_sweep
from desplat_ns.step import Step

STOP_PLACING_AT = 27_000
"""Nominal step from which none is placed or removed for its place any more."""

FOUNDING_AGAIN_AT = 22_500
"""Nominal step from which a visit finds new regions as the first one does: the scene has learned
most of what it will, and what passed only here and there is masked in time."""

LOOK_EVERY = 3
"""In one round of visits in this number the photos are compared with the static scene."""


def apply_mask(
    photo: Float[Tensor, "H W 3"], static: Float[Tensor, "H W 3"], mask: Bool[Tensor, "H W 1"]
) -> tuple[Float[Tensor, "H W 3"], Bool[Tensor, "rows columns"]]:
    """What the user's mask, True in the pixels that count, does: elsewhere the photo is as the
    static scene, a constant. Returns the photo, and the cells of `grid_of` that count."""
    height, width = mask.shape[:2]
    counts = pooled(mask.to(torch.float32), grid_of(width, height))[0] >= 0.5
    return torch.where(mask, photo, static.detach()), counts


class Distractors(nn.Module):
    """A set of distractors for each training view, in `views`, and what decides about them.

    The parameters are none of the module's own: nerfstudio 1.1.5 walks over all modules and all
    parameters of its optimizers in every step, and a step draws one view of what may be thousands.
    """

    def __init__(
        self,
        config: DistractorConfig,
        static: SplatfactoModelConfig,
        cameras: Cameras,
        points: Float[Tensor, "P 3"] | None = None,
        background: BackgroundGrade = "off",
        scale: float = 1.0,
    ):
        """Start every view's distractors; say so where there are too few views to judge by. Raises
        ConfigError where a setting lies outside its range.

        Args:
            config: of this run.
            static: of the static scene; both sets share thresholds.
            points: of the reconstruction, if the scene starts from them.
            scale: steps of the run for each nominal one.
        """
        super().__init__()
        check_ranges(config, "--pipeline.model.distractors")
        self.config = config
        self.views = [ViewDistractors(fill_view(view, config)) for view in views_of(cameras)]
        self.background = background
        self.is_behind_by_chance = background == "off" and static.background_color == "random"
        """A sky, and a colour that the user chose, are part of the scene."""
        every = config.steps_between_refinements(len(cameras), scale)
        self.densifier = DistractorDensifier(config, static, every)
        self.thresholds = Thresholds(strong=config.strong_excess)
        self.sweep = PlaneSweep(points, cameras)
        self.regions: dict[int, Bool[Tensor, "rows columns"]] = {}
        """Those of each view, as it was last looked at."""
        if config.start == "residual" and len(cameras) < FEW_VIEWS:
            announce_once(about_few_views(len(cameras)), warning=True)

    def counts(self) -> list[int]:
        """Number of Gaussians of every training view, counted anew."""
        return [len(view) for view in self.views]

    def look(self, step: Step, opacities: Float[Tensor, "N 1"], state: Mapping[str, Any]) -> None:
        """Apply the user's mask to the photo of a step, and find its regions, if that is due.

        Args:
            step: with photo, static scene, background and mask; gets regions.
            opacities: of the static Gaussians, logits.
            state: of their strategy; it is read only.
        """
        counted, photo = None, step.photo
        if step.mask is not None:
            step.photo, counted = apply_mask(photo, step.static_rgb, step.mask)
        step.regions = self.regions.get(step.index)
        if self.looks(step):
            if step.index not in self.sweep.photos:
                step.sweep_photo = photo_to_sweep(photo, step.mask)
            self._find_regions(step, opacities, state, counted)
        if step.distractors is not None and step.regions is not None:
            height, width = photo.shape[:2]
            step.in_region = region_pixels(step.regions.to(photo.dtype), height, width)

    def looks(self, step: Step) -> bool:
        """Whether the photo is compared with the static scene: in the warm-up, once after it, and
        in every `LOOK_EVERY`th round of visits."""
        if self.config.start != "residual" or len(self.views) <= LEAST_VIEWS:
            return False
        is_due = step.run // len(self.views) % LOOK_EVERY == 0
        is_new = step.index not in self.regions
        return is_due or is_new or step.nominal < self.config.warmup

    @torch.no_grad()
    def _find_regions(
        self,
        step: Step,
        opacities: Float[Tensor, "N 1"],
        state: Mapping[str, Any],
        counted: Bool[Tensor, "rows columns"] | None,
    ) -> None:
        """Find the regions of a step, and what the Gaussians remember; in the warm-up that alone.
        `counted`: cells that the user's mask leaves in; None if it leaves out none."""
        photo, behind = step.photo, step.behind if self.is_behind_by_chance else None
        static = StaticView(
            step.static_rgb.detach(),
            step.static.alpha.detach(),
            None if behind is None else behind.detach(),
            step.static.means2d.detach()[0],
            step.static.visible,
            sigmoid(opacities.detach()[:, 0]),
        )
        residual_medians = medians_in(state, len(opacities), photo.device)
        judged, by = counted, self.thresholds
        if self.background == "image":
            scene = ~own_sky(photo, step.static.alpha)
            judged = scene if counted is None else scene & counted
            by = replace(by, small_window=by.outline_window)  # strips along a sky are no things
        comparison, step.residual_medians = compare(photo, static, residual_medians, judged)
        is_warmup = step.nominal < self.config.warmup
        if is_warmup or not self.sweep.is_ready(step.index, photo.device):
            return  # in the latter case its next visit looks again
        comparison = replace(comparison, counted=counted)  # skies within a thing's outline are it
        earlier = self.regions.get(step.index) if step.nominal < FOUNDING_AGAIN_AT else None
        unexplained = partial(self.sweep.unexplained, step.index, photo.device)
        step.regions = decide(comparison, unexplained, by, earlier)

    def remember(self, step: Step, state: dict[str, Any]) -> None:
        """Take up what a step learned of the views, before the static set is refined, whose rows it
        belongs to. `state`: of that set's strategy."""
        if step.residual_medians is not None:
            state[RESIDUAL_MEDIANS] = step.residual_medians
        if step.sweep_photo is not None:
            self.sweep.keep(step.index, step.sweep_photo)

    @torch.no_grad()
    def commit(
        self, step: Step, weights_of: Callable[[RawParameters], Float[Tensor, " M"]]
    ) -> None:
        """Refine the view's distractors, and place and remove some where a step found its regions.
        `weights_of`: gives what each of the view's distractors makes up of it, in pixels."""
        index, view = step.index, step.view
        distractors = self.views[index]
        if step.distractors is not None:
            # A clamp where they are drawn has no gradient: black and white would stay for ever.
            distractors.params["rgbs"].clamp_(0, 1)
            self.densifier.after_step(distractors, step.nominal, step.distractors, weights_of)
        if step.regions is not None and step.residual_medians is not None:
            self.regions[index] = step.regions
            if step.nominal < STOP_PLACING_AT:
                means, drawn, photo = distractors.params["means"], step.distractors, step.photo
                alpha_d = torch.zeros_like(photo[..., :1]) if drawn is None else drawn.alpha
                changed = placement(view, photo, alpha_d, step.regions, means, self.config)
                if changed is not None:
                    distractors.exchange(*changed)

    def _apply(self, fn: Callable[[Tensor], Tensor], *args: Any, **options: Any) -> Any:
        """torch's hook of `to`: parameters move in place."""
        for view in self.views:
            for parameter in view.params.values():
                parameter.data = fn(parameter.data)
        return super()._apply(fn, *args, **options)

    def get_extra_state(self) -> dict[str, Any]:
        """For a checkpoint: each view's parameters, moments and statistics; regions; photos."""
        views = [view.saved() for view in self.views]
        return {"views": views, "regions": dict(self.regions), "photos": self.sweep.state()}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Take up what `get_extra_state` gave."""
        device = self.views[0].params["means"].device
        for view, saved in zip(self.views, state["views"], strict=True):
            view.load(saved, device)
        self.regions = state_to_device(state["regions"], device)
        self.sweep.load(state["photos"])
