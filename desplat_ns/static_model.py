"""The static scene: Splatfacto's Gaussians, drawn by any backend, in the light of any image."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.scene_box import OrientedBox
from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackAttributes
from nerfstudio.model_components.lib_bilagrid import color_correct
from nerfstudio.models.splatfacto import SH2RGB, SplatfactoModel, SplatfactoModelConfig
from torch import Tensor, nn

from desplat_ns.backend import BackendName, Rasterizer, resolve
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from desplat_ns.backend.ssim import ssim_of_planes
from desplat_ns.effects import Effects, EffectsConfig
from desplat_ns.errors import BackendUnavailableError, ConfigError
from desplat_ns.evaluation.metrics import LazyLpips, image_metrics
from desplat_ns.gaussians.activation import RawParameters, activate_static, resize_rows
from desplat_ns.gaussians.densification import strategy_info
from desplat_ns.gaussians.memory import GaussianMemory
from desplat_ns.gaussians.seed_points import check_seed_points, clamp_seed_scales
from desplat_ns.gaussians.strategy import NEVER, StaticStrategy
from desplat_ns.nerfstudio_quirks import (
    splatfacto_modules_without_cuda,
    splatfacto_modules_without_downloads,
)
from desplat_ns.photo_tourism.appearance import fourier_features
from desplat_ns.photo_tourism.camera_response import fit_response, squared_radius
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.photo_tourism.image_effects import FEATURES, ImageEffects, wants_image_effects
from desplat_ns.photo_tourism.shown_light import ShownLight
from desplat_ns.rendering.compositing import over_background
from desplat_ns.rendering.first_columns import needed_by_columns, rows_of
from desplat_ns.rendering.views import view_of
from desplat_ns.training.run_length import (
    SPLATFACTOS_INTERVAL,
    pause_after_reset,
    photo_downscale,
    scaled_fields,
    scaled_steps,
    steps_between_refinements,
)

STATIC_STEPS = (
    "warmup_length",
    "resolution_schedule",
    "sh_degree_interval",
    "stop_screen_size_at",
    "stop_split_at",
)
"""Splatfacto's settings that are numbers of steps."""


Config = TypeVar("Config", bound="StaticModelConfig")


@dataclass
class StaticModelConfig(SplatfactoModelConfig):
    """The static scene, with what DeSplat adds to Splatfacto's settings.

    Every number of steps belongs to the full schedule; `schedule_scale` shrinks them all.
    """

    _target: type = field(default_factory=lambda: StaticModel)
    effects: EffectsConfig = field(default_factory=EffectsConfig)
    """Which effects the scene calls for."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """Per-image appearance, where `effects.appearance` has it."""
    background: BackgroundConfig = field(default_factory=BackgroundConfig)
    """Background model, where `effects.background` has it."""
    backend: BackendName = "auto"
    """Rasterizer. auto takes gsplat where CUDA works, else the fastest that runs on the CPU."""
    schedule_scale: float | None = None
    """Factor on every number of steps; by default max-num-iterations over the method's own number,
    at most 1."""

    refine_every: int = 0
    """Steps between two refinements of the static set, at most; 0 for no bound. Splatfacto has 100,
    in runs of any length."""
    refinements: int = 15
    """Refinements that a run has time for, however long it is: they are as many steps apart as
    `stop_split_at` has by this number, and at least half a round of the views. See
    docs/separation.md, "How often, and how many"."""
    gaussians_per_pixel: float = 0.0
    """Static Gaussians at most, per pixel of all training photos together: more than the photos can
    hold in place become floaters. 0 for no limit, as in the paper. A capture that starts with more
    keeps those, but does not grow."""
    cull_to_the_end: bool = False
    """Prune faint static Gaussians after `stop_split_at` as well. Splatfacto did so when the paper
    was written (nerfstudio 1.1.4: `continue_cull_post_densification`)."""

    def for_run(self: Config, num_views: int) -> Config:
        """A copy for one run: its steps shrunk by `schedule_scale`, its intervals as the number of
        training views wants them.

        Raises:
            ConfigError: a setting lies outside its range.
        """
        self._check()
        run = replace(self, **scaled_fields(self, STATIC_STEPS, self.schedule_scale or 1.0))
        run.refine_every = steps_between_refinements(
            num_views, run.stop_split_at, self.refinements, self.refine_every
        )
        return run

    def _check(self) -> None:
        for name, value, least in (
            ("refine-every", self.refine_every, 0),
            ("refinements", self.refinements, 1),
            ("gaussians-per-pixel", self.gaussians_per_pixel, 0),
        ):
            if not value >= least:
                raise ConfigError(
                    f"`--pipeline.model.{name}` is {value}; it has to be {least} or more."
                )

    def downscale_factor(self, step: int) -> int:
        """By how much photos are smaller at a step. Call it on what `for_run` gave."""
        return photo_downscale(step, self.num_downscales, self.resolution_schedule)

    @property
    def reset_every(self) -> int:
        """Steps from one reset of the static opacities to the next; `reset_alpha_every` 0: none."""
        steps = self.reset_alpha_every * SPLATFACTOS_INTERVAL
        return scaled_steps(steps, self.schedule_scale or 1.0) if steps > 0 else NEVER

    def most_gaussians(self, pixels: int) -> int:
        """Static Gaussians beyond which the set does not grow.

        Args:
            pixels: of all training photos together.
        """
        return round(self.gaussians_per_pixel * pixels) if self.gaussians_per_pixel > 0 else NEVER


class StaticModel(SplatfactoModel):
    """Splatfacto with a backend of choice, and with the per-image effects that are on."""

    config: StaticModelConfig
    effects: Effects
    """Those of this model, all decided."""
    image_effects: ImageEffects | None
    lpips: LazyLpips  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, config: StaticModelConfig, *args: Any, **kwargs: Any):
        self._rasterizer: Rasterizer | None = None
        super().__init__(config, *args, **kwargs)

    def populate_modules(self) -> None:
        """Static Gaussians at the 3D points, and what the effects need."""
        if not self.config.random_init:
            check_seed_points(self.seed_points)
        self.config = self.config.for_run(self.num_train_data)
        self.effects = self.config.effects.settled()
        with splatfacto_modules_without_downloads(), splatfacto_modules_without_cuda(self):
            super().populate_modules()
        clamp_seed_scales(self.gauss_params)
        del self.ssim  # a module, whose place only another module could take
        self.ssim = ssim_of_planes
        self._settle_strategy()
        self._add_image_effects()

    def _settle_strategy(self) -> None:
        """Refinement and resets as this run and this capture want them."""
        config, cameras = self.config, self.kwargs["metadata"]["train_cameras"]
        pixels = int((cameras.width * cameras.height).sum())
        self.strategy = StaticStrategy.in_place_of(
            self.strategy,
            reset_every=config.reset_every,
            pause_refine_after_reset=pause_after_reset(self.num_train_data, config.reset_every),
            most=config.most_gaussians(pixels),
            cull_to_the_end=config.cull_to_the_end,
            verbose=False,
        )

    def _get_downscale_factor(self) -> int:
        """By how much photos are smaller than they are; Splatfacto's hook."""
        return self.config.downscale_factor(self.step) if self.training else 1

    def _add_image_effects(self) -> None:
        config, self.image_effects = self.config, None
        self.shown_light = ShownLight([])
        if not wants_image_effects(self.effects):
            return
        self.image_effects = ImageEffects(
            self.effects,
            config.appearance,
            config.background,
            self.num_train_data,
            config.sh_degree,
        )
        if self.image_effects.appearance is not None:
            frequencies = config.appearance.fourier_frequencies
            features = fourier_features(self.means.detach(), frequencies)
            self.gauss_params[FEATURES] = nn.Parameter(features)
        if self.effects.image_light:
            self.shown_light = ShownLight(self.kwargs["metadata"].get("train_image_names", []))

    def get_param_groups(self) -> dict[str, list[nn.Parameter]]:
        """Splatfacto's groups and those of the effects."""
        groups = super().get_param_groups()
        if self.image_effects is not None:
            groups |= self.image_effects.param_groups()
        if FEATURES in self.gauss_params:
            groups[FEATURES] = [self.gauss_params[FEATURES]]
        return groups

    @property
    def rasterizer(self) -> Rasterizer:
        """The backend, chosen when first needed.

        Raises:
            BackendUnavailableError: in training, if the configured backend cannot run here. What
                was trained elsewhere is rendered with what there is.
        """
        if self._rasterizer is None:
            try:
                self._rasterizer = resolve(self.config.backend, self.device.type)
            except BackendUnavailableError:
                if self.training:
                    raise
                return resolve("auto", self.device.type)
        return self._rasterizer

    def view_of_camera(self, camera: Cameras, index: int | None) -> View:
        """The view of a camera; training views have the pose that the pose optimizer found."""
        assert camera.shape[0] == 1, "one camera at a time"
        pose = camera.camera_to_worlds
        if index is not None:
            camera.metadata = {**(camera.metadata or {}), "cam_idx": index}
            pose = self.camera_optimizer.apply_to_camera(camera)
        view = view_of(camera, pose[0], self._get_downscale_factor())
        self.last_size = (view.height, view.width)
        return view

    def render_settings(self, depth: bool) -> RenderSettings:
        return RenderSettings(
            antialiased=self.config.rasterize_mode == "antialiased",
            depth=depth,
            absgrad=self.training and self.config.use_absgrad,
        )

    def _sh_degree(self) -> int | None:
        if self.config.sh_degree == 0:
            return None
        return min(self.step // self.config.sh_degree_interval, self.config.sh_degree)

    @property
    def memory(self) -> GaussianMemory:
        """What is remembered of each static Gaussian."""
        return GaussianMemory(self.strategy_state)

    def embedding_of(self, index: int | None) -> Tensor | None:
        """The image embedding [E] to draw with; None where no effect needs one.

        In training that of training view `index`; else the one chosen to be shown, else that of
        view `index`, or the average of all if it is None.
        """
        if self.image_effects is None:
            return None
        if self.training and index is not None:
            return self.image_effects.of(index)
        return self.shown_light.embedding(self.image_effects, index)

    def average_embedding(self) -> Tensor:
        """The mean [E] of the training images' embeddings. Call it only if an effect has some."""
        assert self.image_effects is not None
        return self.image_effects.mean()

    def shown_in(self, embedding: Tensor) -> AbstractContextManager[None]:
        """Within, every image that is drawn outside of training has this embedding [E]."""
        return self.shown_light.fixed(embedding)

    def background_of(self, view: View, embedding: Tensor | None) -> Tensor:
        """Colours [3], or [H, W, 3] where they differ or nerfstudio's commands expect them."""
        if self.image_effects is not None and self.image_effects.background is not None:
            assert embedding is not None
            degree = self.step // self.config.sh_degree_interval
            return self.image_effects.background_of(embedding, view, degree)
        color = self._get_background_color()
        return color if self.training else color.expand(view.height, view.width, 3)

    def image_of(
        self, static: Rendering, background: Tensor, view: View, embedding: Tensor | None
    ) -> Tensor:
        """The static scene over the background [H, W, 3], as the image's camera shows it.

        Colours may be beyond 1.
        """
        image = over_background(static.rgb, static.alpha, background)
        return self.photographed(image, view, embedding)

    def photographed(self, colors: Tensor, view: View, embedding: Tensor | None) -> Tensor:
        """Colours of the scene, one [3] or an image [H, W, 3], as the image's camera shows them."""
        if self.image_effects is None or embedding is None:
            return colors
        return self.image_effects.photographed(colors, view, embedding)

    def as_function_of_embedding(
        self, view: View, columns: int | None = None
    ) -> Callable[[Tensor], Tensor]:
        """The static scene [H, W, 3] seen from `view`, given an image embedding [E].

        Everything else is held constant. Where `columns` is given, only as many of the first ones
        are right: what they do not need is left out.
        """
        constants = {name: value.detach() for name, value in self.gauss_params.items()}
        settings, splats = self.render_settings(depth=False), self._splats(constants, None)
        if columns is not None:
            needed = needed_by_columns(self.rasterizer, splats, view, settings, columns)
            constants = {name: value[needed] for name, value in constants.items()}
            splats = rows_of(splats, needed)
        lit = self._lit(splats, constants, view, settings, frozen=True)
        static = self.rasterizer(splats, view, settings)

        def draw(embedding: Tensor) -> Tensor:
            drawn = static if lit is None else self.rasterizer(lit(embedding), view, settings)
            background = self.background_of(view, embedding)
            return self.image_of(drawn, background, view, embedding).clamp(0, 1)

        return draw

    @torch.no_grad()
    def embedding_in_closed_form(self, view: View, photo: Tensor, seen: Tensor) -> Tensor | None:
        """The embedding [E] that explains a photo [H, W, 3] best in the pixels `seen` [H, W]; None
        if it takes an optimizer to find it."""
        if self.effects.appearance != "camera" or self.effects.image_embeddings:
            return None
        splats = self._splats(self.gauss_params, None)
        static = self.rasterizer(splats, view, self.render_settings(depth=False))
        background = self.background_of(view, self.average_embedding())
        image = self.image_of(static, background, view, None)
        return fit_response(image[seen], photo[seen], squared_radius(view)[seen])

    def _lit(
        self,
        splats: Splats,
        params: RawParameters,
        view: View,
        settings: RenderSettings,
        frozen: bool = False,
    ) -> Callable[[Tensor], Splats] | None:
        """Gives the static Gaussians in the colours of an embedding, as far as `view` shows them;
        None if they have the same in all."""
        if self.image_effects is None or FEATURES not in params:
            return None
        return self.image_effects.lit(splats, params[FEATURES], view, settings, frozen)

    def _splats(self, params: RawParameters, embedding: Tensor | None) -> Splats:
        """Static Gaussians in the colours of the image that `embedding` describes."""
        splats = activate_static(params, self._sh_degree())
        if self.image_effects is None or embedding is None or FEATURES not in params:
            return splats
        return self.image_effects.toned(splats, params[FEATURES], embedding)

    @torch.no_grad()
    def baked_coefficients(self) -> Tensor:
        """SH coefficients [N, K, 3] in the light that is shown: what a PLY can hold of it."""
        return self._splats(self.gauss_params, self.embedding_of(None)).colors

    @property
    def shs_0(self) -> Tensor:
        """Zeroth SH coefficients [N, 3] that `ns-export` writes."""
        baked = FEATURES in self.gauss_params
        return self.baked_coefficients()[:, 0] if baked else super().shs_0

    @property
    def shs_rest(self) -> Tensor:
        """The other SH coefficients [N, K - 1, 3] that `ns-export` writes."""
        baked = FEATURES in self.gauss_params
        return self.baked_coefficients()[:, 1:] if baked else super().shs_rest

    @property
    def colors(self) -> Tensor:
        """Colours [N, 3] without view dependence, about [0, 1]."""
        baked = FEATURES in self.gauss_params
        return SH2RGB(self.baked_coefficients()[:, 0]) if baked else super().colors

    def step_post_backward(self, step: int) -> None:
        """Splatfacto's refinement, and what the per-image effects have to keep."""
        super().step_post_backward(step)
        if self.image_effects is not None:
            self.image_effects.after_step()

    def render_static(self, view: View, embedding: Tensor | None) -> Rendering:
        crop = self.crop_box if not self.training else None
        keep = None if crop is None else crop.within(self.means).reshape(-1)
        depth = self.config.output_depth_during_training or not self.training
        params: RawParameters = self.gauss_params
        if keep is not None:
            params = {name: value[keep] for name, value in params.items()}
        settings, splats = self.render_settings(depth), self._splats(params, None)
        lit = None if embedding is None else self._lit(splats, params, view, settings)
        if embedding is not None and lit is not None:
            splats = lit(embedding)
        rendering = self.rasterizer(splats, view, settings)
        if self.training:
            self.info = strategy_info(rendering, view)
            self.strategy.step_pre_backward(
                self.gauss_params, self.optimizers, self.strategy_state, self.step, self.info
            )
        return rendering

    @torch.no_grad()
    def get_outputs_for_camera(
        self, camera: Cameras, obb_box: OrientedBox | None = None
    ) -> dict[str, Tensor]:
        """`get_outputs` without gradients, within a box if one is given."""
        return super().get_outputs_for_camera(camera, obb_box)  # pyright: ignore[reportReturnType]

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
        photo = self.composite_with_background(
            self.get_gt_img(batch["image"]), outputs["background"]
        )
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
