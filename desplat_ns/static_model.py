"""The static scene: Splatfacto's Gaussians, drawn by any backend, in the light of any image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.scene_box import OrientedBox
from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackAttributes
from nerfstudio.model_components.lib_bilagrid import color_correct
from nerfstudio.models.splatfacto import SH2RGB, SplatfactoModel
from torch import Tensor, nn

from desplat_ns.backend import Rasterizer, resolve
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from desplat_ns.backend.ssim import ssim_of_planes
from desplat_ns.errors import BackendUnavailableError
from desplat_ns.evaluation.metrics import image_metrics
from desplat_ns.gaussians.activation import RawParameters, activate_static, resize_rows
from desplat_ns.gaussians.densification import strategy_info
from desplat_ns.gaussians.seed_points import check_seed_points, clamp_seed_scales
from desplat_ns.gaussians.strategy import StaticStrategy
from desplat_ns.model import DeSplatModelConfig
from desplat_ns.nerfstudio_quirks import (
    splatfacto_modules_without_cuda,
    splatfacto_modules_without_downloads,
)
from desplat_ns.photo_tourism.appearance import fourier_features
from desplat_ns.photo_tourism.image_effects import FEATURES, ImageEffects, wants_image_effects
from desplat_ns.photo_tourism.shown_light import WornAppearance
from desplat_ns.rendering.layers import static_outputs
from desplat_ns.rendering.views import view_of


class StaticModel(SplatfactoModel):
    """Splatfacto with a backend of choice, and with the per-image effects that are on."""

    config: DeSplatModelConfig
    image_effects: ImageEffects | None
    lpips: Any  # a LazyLpips in the place of torchmetrics' module

    def __init__(self, config: DeSplatModelConfig, *args: Any, **kwargs: Any):
        self._rasterizer: Rasterizer | None = None
        super().__init__(config.scaled(), *args, **kwargs)

    def populate_modules(self) -> None:
        """Static Gaussians at the 3D points, and what the effects need."""
        if not self.config.random_init:
            check_seed_points(self.seed_points)
        self.config = self.config.for_views(self.num_train_data)
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
            pause_refine_after_reset=config.pause_after_reset(self.num_train_data),
            most=config.most_gaussians(pixels),
            cull_to_the_end=config.cull_to_the_end,
            verbose=False,
        )

    def _get_downscale_factor(self) -> int:
        """By how much photos are smaller than they are; Splatfacto's hook."""
        return self.config.downscale_factor(self.step) if self.training else 1

    def _add_image_effects(self) -> None:
        config, self.image_effects = self.config, None
        self.worn = WornAppearance([])
        if not wants_image_effects(config.effects):
            return
        self.image_effects = ImageEffects(
            config.effects,
            config.appearance,
            config.background,
            self.num_train_data,
            config.sh_degree,
        )
        if config.effects.appearance != "off":
            frequencies = config.appearance.fourier_frequencies
            features = fourier_features(self.means.detach(), frequencies)
            self.gauss_params[FEATURES] = nn.Parameter(features)
            self.worn = WornAppearance(self.kwargs["metadata"].get("train_image_names", []))

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

    def embedding_of(self, index: int | None) -> Tensor | None:
        """The image embedding [E] to draw with; None where no effect needs one.

        In training that of training view `index`; else what is worn, else that of view `index`, or
        the average of all where it is None.
        """
        if self.image_effects is None:
            return None
        embeddings = self.image_effects.embeddings
        if self.training and index is not None:
            return embeddings.of(index)
        return self.worn.embedding(embeddings, index)

    def background_of(self, view: View, embedding: Tensor | None) -> Tensor:
        """Colours [3], or [H, W, 3] where they differ or nerfstudio's commands expect them."""
        if self.image_effects is not None and self.image_effects.background is not None:
            assert embedding is not None
            degree = self.step // self.config.sh_degree_interval
            return self.image_effects.background_of(embedding, view, degree)
        color = self._get_background_color()
        return color if self.training else color.expand(view.height, view.width, 3)

    def as_function_of_embedding(self, view: View) -> Callable[[Tensor], Tensor]:
        """The static scene [H, W, 3] seen from `view`, given an image embedding [E].

        Everything else is held constant.
        """
        constants = {name: value.detach() for name, value in self.gauss_params.items()}

        def draw(embedding: Tensor) -> Tensor:
            splats = self._splats(constants, embedding)
            static = self.rasterizer(splats, view, self.render_settings(depth=False))
            return static_outputs(static, self.background_of(view, embedding))["rgb"]

        return draw

    def _splats(self, params: RawParameters, embedding: Tensor | None) -> Splats:
        """Static Gaussians in the colours of the image that `embedding` describes."""
        splats = activate_static(params, self._sh_degree())
        if self.image_effects is None or embedding is None or FEATURES not in params:
            return splats
        return self.image_effects.toned(splats, params[FEATURES], embedding)

    @torch.no_grad()
    def baked_coefficients(self) -> Tensor:
        """SH coefficients [N, K, 3] in the appearance that is worn: what a PLY can hold of it."""
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

    def render_static(self, view: View, embedding: Tensor | None) -> Rendering:
        crop = self.crop_box if not self.training else None
        keep = None if crop is None else crop.within(self.means).reshape(-1)
        depth = self.config.output_depth_during_training or not self.training
        params: RawParameters = self.gauss_params
        if keep is not None:
            params = {name: value[keep] for name, value in params.items()}
        splats = self._splats(params, embedding)
        rendering = self.rasterizer(splats, view, self.render_settings(depth))
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
