"""The static scene: Splatfacto's Gaussians, with the schedule and the limits of this run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import torch
from gsplat.strategy import DefaultStrategy
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackAttributes
from nerfstudio.model_components.lib_bilagrid import color_correct, total_variation_loss
from torch import Tensor, nn

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.backend.spherical_harmonics import MAX_DEGREE
from desplat_ns.gaussians.activation import RawParameters, resize_rows
from desplat_ns.gaussians.densification import strategy_info
from desplat_ns.gaussians.memory import GaussianMemory
from desplat_ns.gaussians.room import most_in_memory
from desplat_ns.gaussians.seed_points import check_seed_points, clamp_seed_scales
from desplat_ns.gaussians.strategy import UNLIMITED, StaticStrategy
from desplat_ns.lit_model import LitModel, LitModelConfig
from desplat_ns.nerfstudio_quirks import (
    splatfacto_modules_without_cuda,
    splatfacto_modules_without_downloads,
)
from desplat_ns.rendering.metrics import LazyLpips, image_metrics
from desplat_ns.rendering.near_plane import sampled, scene_start, stands_clear
from desplat_ns.rendering.photo_angle import PhotoAngle
from desplat_ns.rendering.views import views_of
from desplat_ns.settings.options import check_ranges, ranged
from desplat_ns.training.budget import Clock
from desplat_ns.training.losses import mean_shown_opacity, photometric_loss
from desplat_ns.training.run_length import (
    SPLATFACTOS_INTERVAL,
    pause_after_reset,
    photo_downscale,
    steps_between_refinements,
)

Config = TypeVar("Config", bound="StaticModelConfig")


@dataclass
class StaticModelConfig(LitModelConfig):
    """The static scene, with what DeSplat adds to Splatfacto's settings.

    Numbers of steps are nominal, of a run of the method's own length, unless they say otherwise.
    """

    _target: type = field(default_factory=lambda: StaticModel)
    schedule_scale: float | None = None
    """Steps of the run for each nominal step; by default max-num-iterations over the method's own
    number, at most 1."""

    refine_every: int = ranged(0, "[0, inf)")
    """Steps of the run between two refinements of the static set, at most; 0 for no bound.
    Splatfacto has 100, in runs of any length."""
    sh_degree: int = ranged(3, f"[0, {MAX_DEGREE}]")
    """Degree of the harmonics in which static Gaussians hold their colours."""
    sh_degree_interval: int = ranged(1000, "[1, inf)")
    """Steps after which one degree more is learned."""
    refinements: int = ranged(15, "[1, inf)")
    """Refinements of the static set in a run, whatever its length: they are as many steps apart as
    `stop_split_at` has by this number, and at least half a round of the views. See
    docs/explain/separation.md, "How often Gaussians are refined"."""
    train_downscale: int = ranged(1, "[1, inf)")
    """Factor by which photos are smaller in training at least, to the end; a step then costs less.
    Renderings and evaluation have their full size."""
    gaussians_per_pixel: float = ranged(0.0, "[0, inf)")
    """Static Gaussians at most, per pixel of all training photos together: more than the photos can
    hold in place become floaters. 0 for no such limit, as in the paper. In any case at most as many
    as fit into memory. A capture that starts with more keeps those, but does not grow."""
    opacity_prior: float = ranged(0.0, "[0, inf)")
    """Weight of the mean opacity of the static Gaussians that a photo shows, divided by the number
    of training photos: the fewer there are, the more it says beside them. What no photo needs fades
    and is pruned (docs/explain/separation.md, "What the static scene trains on"). 0 in the paper.
    It counts as 0 where each photo has a light of its own (`effects.appearance`): there the scene
    fades."""
    near_plane: float = ranged(0.0, "[0, 1)")
    """Renderings leave out static Gaussians that are nearer than this share of the depth at which
    the seed points in the view start, and those before that start that reach the camera
    (`stands_clear`): what hangs there contradicts no photo, and hides the scene. Training draws
    them. 0 in the paper: nothing is left out."""
    cull_to_the_end: bool = False
    """Prune faint static Gaussians after `stop_split_at` as well. Splatfacto did so when the paper
    was written (nerfstudio 1.1.4: `continue_cull_post_densification`)."""

    def for_run(self: Config, num_views: int) -> Config:
        """A copy for one run, its intervals as the number of training views wants them.

        Raises:
            ConfigError: a setting lies outside its range.
        """
        check_ranges(self, "--pipeline.model")
        run, scale = replace(self), self.schedule_scale or 1.0
        densification = max(1, round(self.stop_split_at * scale))
        run.refine_every = steps_between_refinements(
            num_views, densification, self.refinements, self.refine_every
        )
        if self.effects.settled().appearance != "off":
            run.opacity_prior = 0.0
        return run

    def downscale_factor(self, step: int) -> int:
        """By how much photos are smaller at a nominal step. Call it on what `for_run` gave."""
        usual = photo_downscale(step, self.num_downscales, self.resolution_schedule)
        return max(self.train_downscale, usual)

    @property
    def reset_every(self) -> int:
        """Nominal steps from one reset of the static opacities to the next; `reset_alpha_every` 0:
        none."""
        steps = self.reset_alpha_every * SPLATFACTOS_INTERVAL
        return steps if steps > 0 else UNLIMITED

    def most_gaussians(self, pixels: int, device: str | torch.device) -> int:
        """Static Gaussians beyond which the set does not grow.

        Args:
            pixels: of all training photos together.
            device: in whose memory they have to fit.
        """
        wanted = self.gaussians_per_pixel * pixels
        room = most_in_memory(device)
        return min(round(wanted), room) if self.gaussians_per_pixel > 0 else room


class StaticModel(LitModel):
    """The static scene as a run trains it: its schedule, refinement and checkpoints."""

    config: StaticModelConfig
    lpips: LazyLpips  # pyright: ignore[reportIncompatibleVariableOverride]
    shown: Tensor
    """Which static Gaussians [N] the view that was last drawn in training shows."""

    def populate_modules(self) -> None:
        """Static Gaussians at the 3D points, and what the effects need."""
        if not self.config.random_init:
            check_seed_points(self.seed_points)
        self.config = self.config.for_run(self.num_train_data)
        self.clock = Clock(self.config.schedule_scale or 1.0)
        self.effects = self.config.effects.settled()
        with splatfacto_modules_without_downloads(), splatfacto_modules_without_cuda(self):
            super().populate_modules()
        clamp_seed_scales(self.gauss_params)
        self._settle_strategy()
        self.add_image_effects()

    def _settle_strategy(self) -> None:
        """Refinement and resets as this run and this capture want them."""
        config, cameras = self.config, self.kwargs["metadata"]["train_cameras"]
        pixels = int((cameras.width * cameras.height).sum())
        assert isinstance(self.strategy, DefaultStrategy)
        self.strategy = StaticStrategy.in_place_of(
            self.strategy,
            reset_every=config.reset_every,
            pause_refine_after_reset=pause_after_reset(
                self.num_train_data, config.reset_every, self.clock.scale
            ),
            most=config.most_gaussians(pixels, self.kwargs.get("device", "cpu")),
            cull_to_the_end=config.cull_to_the_end,
            verbose=False,
        )

    def _get_downscale_factor(self) -> int:
        """By how much photos are smaller than they are; Splatfacto's hook."""
        return self.config.downscale_factor(self.nominal_step) if self.training else 1

    def get_loss_dict(
        self, outputs: dict[str, Any], batch: dict[str, Any], metrics_dict: Any = None
    ) -> dict[str, Tensor]:
        """Splatfacto's terms, and what `opacity-prior` charges."""
        photo = self.photo_of(outputs, batch)
        main_loss = self.photometric_term(outputs["rgb"], photo, self.mask_of(batch, photo.device))
        return {"main_loss": main_loss} | self.regularizers()

    def photo_of(self, outputs: dict[str, Any], batch: dict[str, Any]) -> Tensor:
        """The photo [H, W, 3] at the step's size; what is transparent shows the background."""
        return self.composite_with_background(
            self.get_gt_img(batch["image"]), outputs["background"]
        )

    def mask_of(self, batch: dict[str, Any], device: torch.device) -> Tensor | None:
        """The user's mask [H, W, 1], True in the pixels that count: where photos are smaller than
        they are, if at least half of the rectangle counts (`resize_mask`). None if there is none.
        """
        if "mask" not in batch:
            return None
        return (self._downscale_if_required(batch["mask"]) >= 0.5).to(device)

    def photometric_term(self, image: Tensor, photo: Tensor, mask: Tensor | None) -> Tensor:
        """L_GS of an image; what is masked is black in it and in the photo."""
        if mask is not None:
            image, photo = image * mask, photo * mask
        return photometric_loss(image, photo, self.config.ssim_lambda)

    def regularizers(self) -> dict[str, Tensor]:
        """The other terms of Splatfacto (nerfstudio 1.1.5), and what `opacity-prior` charges."""
        losses, config = {}, self.config
        if config.use_scale_regularization and self.step % 10 == 0:
            scales = torch.exp(self.scales)
            ratio = scales.amax(dim=-1) / scales.amin(dim=-1)
            losses["scale_reg"] = 0.1 * (ratio - config.max_gauss_ratio).clamp(min=0).mean()
        if not self.training:
            return losses
        self.camera_optimizer.get_loss_dict(losses)
        if config.use_bilateral_grid:
            losses["tv_loss"] = 10 * total_variation_loss(self.bil_grids.grids)
        if config.opacity_prior > 0:
            weight, opacities = config.opacity_prior / self.num_train_data, self.opacities
            losses["opacity_prior"] = weight * mean_shown_opacity(opacities, self.shown)
        return losses

    def step_post_backward(self, step: int) -> None:
        """Refinement and resets after a step, and what the per-image effects have to keep."""
        self.strategy.step_post_backward(
            self.gauss_params, self.optimizers, self.strategy_state, self.nominal_step, self.info
        )
        if self.image_effects is not None:
            self.image_effects.after_step()

    @property
    def memory(self) -> GaussianMemory:
        """What is remembered of each static Gaussian."""
        return GaussianMemory(self.strategy_state)

    def params_in(self, view: View) -> RawParameters:
        """All in training; else those in the crop box that do not stand before the camera."""
        if self.training:
            return self.gauss_params
        keep = []
        if self.crop_box is not None:
            keep.append(self.crop_box.within(self.means).reshape(-1))
        share, points = self.near_plane_share(), self.points
        if share > 0 and points is not None:
            start, shape = scene_start(points, view), (self.means, self.quats, self.scales.exp())
            keep.append(stands_clear(*shape, view, start, share))
        if not keep:
            return self.gauss_params
        shown = torch.stack(keep).all(dim=0)
        return {name: value[shown] for name, value in self.gauss_params.items()}

    def near_plane_share(self) -> float:
        """Of the depth at which the scene starts: nearer, a rendering shows nothing static."""
        return self.config.near_plane

    @cached_property
    def points(self) -> Tensor | None:
        """Of the reconstruction [P, 3], as many as say where the scene starts in a view; None if
        the scene did not start from them."""
        if not self.has_points:
            return None
        assert self.seed_points is not None
        return sampled(self.seed_points[0]).to(self.device)

    @property
    def has_points(self) -> bool:
        """Whether the scene started from a reconstruction's points."""
        return self.seed_points is not None and not self.config.random_init

    @cached_property
    def photo_angle(self) -> PhotoAngle:
        """How far views are from the training photos. Ask for it only if `has_points`."""
        assert self.points is not None
        cameras: Cameras = self.kwargs["metadata"]["train_cameras"]
        return PhotoAngle(self.points, views_of(cameras.to(self.device)))

    def render_static(self, view: View, embedding: Tensor | None) -> Rendering:
        depth = self.config.output_depth_during_training or not self.training
        params = self.params_in(view)
        settings, splats = self.render_settings(depth), self._splats(params, None)
        lit = None if embedding is None else self._lit(splats, params, view)
        if embedding is not None and lit is not None:
            splats = lit(embedding)
        rendering = self.rasterizer(splats, view, settings)
        if self.training:
            self.shown, self.info = rendering.visible, strategy_info(rendering, view)
            self.strategy.step_pre_backward(
                self.gauss_params, self.optimizers, self.strategy_state, self.step, self.info
            )
        return rendering

    def get_training_callbacks(
        self, training_callback_attributes: TrainingCallbackAttributes
    ) -> list[TrainingCallback]:
        """Splatfacto's, after making sure that the backend runs: better now than at step 0."""
        _ = self.rasterizer  # raises where it cannot run
        return super().get_training_callbacks(training_callback_attributes)

    def get_image_metrics_and_images(
        self, outputs: dict[str, Tensor], batch: dict[str, Any]
    ) -> tuple[dict[str, float], dict[str, Tensor]]:
        """Figures of one evaluation image, and the photo beside the rendering."""
        photo = self.photo_of(outputs, batch)
        figures = image_metrics(outputs["rgb"], photo, self.lpips)
        if self.config.color_corrected_metrics:
            corrected = image_metrics(color_correct(outputs["rgb"], photo), photo, self.lpips)
            figures |= {f"cc_{name}": value for name, value in corrected.items()}
        return figures, {"img": torch.cat([photo, outputs["rgb"]], dim=1)}

    def update_to_step(self, step: int) -> None:
        """Take up a checkpoint's step: it decides on the SH degree."""
        self.step = step

    def load_state_dict(self, dict: Any, **kwargs: Any) -> Any:
        """nn.Module's: Splatfacto's replaces the parameters that the optimizers hold."""
        return nn.Module.load_state_dict(self, dict, **kwargs)

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *args: Any) -> None:
        """torch's hook, called before the children load: take the saved number of Gaussians."""
        resize_rows(self.gauss_params, state_dict, f"{prefix}gauss_params.")
        super()._load_from_state_dict(state_dict, prefix, *args)
