"""DeSplat as a nerfstudio model: wiring; settings and formulas are elsewhere."""

from __future__ import annotations

import math
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.scene_box import OrientedBox
from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackAttributes
from nerfstudio.model_components.lib_bilagrid import color_correct
from nerfstudio.models.splatfacto import SplatfactoModel
from torch import Tensor, nn

from desplat_ns.backend import Rasterizer, resolve
from desplat_ns.backend.protocol import Rendering, RenderSettings, View
from desplat_ns.cameras import train_index, view_of
from desplat_ns.densification import DistractorDensifier, strategy_info, to_device
from desplat_ns.distractors import DistractorGaussians
from desplat_ns.errors import BackendUnavailableError, CaptureError, DeSplatError
from desplat_ns.fast_ssim import ssim_of_planes
from desplat_ns.gaussians import activate_distractors, activate_static, resize_rows
from desplat_ns.losses import (
    distractor_opacity_loss,
    static_photometric_loss,
    static_transparency_loss,
)
from desplat_ns.metrics import image_metrics
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.outputs import layered_outputs, static_outputs
from desplat_ns.separation import Placement, Sighting, owned_share
from desplat_ns.upstream import (
    splatfacto_modules_without_cuda,
    splatfacto_modules_without_downloads,
)
from desplat_ns.viewer import LayerControl

MIN_SEED_POINTS = 4
"""Splatfacto sizes each Gaussian by its three nearest neighbours."""

MIN_SEED_SCALE = 1e-6
"""World units. Coincident 3D points have neighbours at distance 0, whose logarithm is no scale."""


class DeSplatModel(SplatfactoModel):
    """Static Gaussians shared by all views, and distractor Gaussians for each training view."""

    config: DeSplatModelConfig
    distractors: DistractorGaussians | None
    lpips: Any  # a LazyLpips in the place of torchmetrics' module

    def __init__(self, config: DeSplatModelConfig, *args: Any, **kwargs: Any):
        self._rasterizer: Rasterizer | None = None
        super().__init__(config.scaled(), *args, **kwargs)

    def populate_modules(self) -> None:
        """Static Gaussians at the 3D points, distractors in front of every training camera."""
        self._check_seed_points()
        with splatfacto_modules_without_downloads(), splatfacto_modules_without_cuda(self):
            super().populate_modules()
        self.gauss_params["scales"].data.clamp_(min=math.log(MIN_SEED_SCALE))
        del self.ssim  # a module, whose place only another module could take
        self.ssim = ssim_of_planes
        self.strategy.verbose = False
        self.strategy.pause_refine_after_reset = self.config.pause_after_reset(self.num_train_data)
        self.distractors = None
        self.layer_control = LayerControl(0)
        if self.config.effects.distractors:
            cameras: Cameras = self.kwargs["metadata"]["train_cameras"]
            self.distractors = DistractorGaussians(self.config.distractors, cameras)
            self.densifier = DistractorDensifier(
                self.config.distractors, self.config, self.num_train_data
            )
            self.placement = Placement(self.config.distractors, self.num_train_data)
            self.layer_control = LayerControl(self.num_train_data)
        self._distractors_drawn: tuple[int, dict[str, Any]] | None = None

    def _check_seed_points(self) -> None:
        if self.config.random_init or self.seed_points is None:  # both start at random
            return
        found = len(self.seed_points[0])
        if found < MIN_SEED_POINTS:
            raise CaptureError(
                f"The capture has {found} 3D points; static Gaussians start at the points of the "
                f"reconstruction and need at least {MIN_SEED_POINTS}. Give a reconstruction with "
                "points, or add `--pipeline.model.random-init True`."
            )

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

    def get_outputs(self, camera: Cameras) -> dict[str, Tensor]:
        """Render one camera.

        Returns:
            Images [H, W, C] with colours in [0, 1]: rgb (in training what the loss sees, else the
            static scene), depth (world units; not in training), accumulation, background; with
            distractors also rgb_static, rgb_composite, rgb_distractor (weighted by its alpha),
            alpha_distractor and distractor_mask (bool).
        """
        index = train_index(camera)
        view = self._view_of(camera, index)
        static = self._render_static(view)
        if index is None and not self.training:
            index = self.layer_control.train_idx()
        distractor = self._render_distractors(view, index)
        if self.training and index is not None:
            self.drawn = (index, view)
        background = self._get_background_color()
        if not self.training:
            background = background.expand(view.height, view.width, 3)
        outputs = static_outputs(static, background)
        if self.distractors is not None:
            outputs["rgb_static"] = outputs["rgb"]
            alone = (
                self.training and distractor is not None and self.config.distractors.static_alone
            )
            beneath = static.detached() if alone else static
            outputs |= layered_outputs(beneath, distractor, background)
        if not self.training:
            return self.layer_control.apply(outputs)
        if self.distractors is not None:
            outputs["rgb"] = outputs["rgb_composite"]
        if self.config.use_bilateral_grid and index is not None:
            for name in outputs.keys() & {"rgb", "rgb_static"}:
                toned = self._apply_bilateral_grid(outputs[name][None], index, *self.last_size)
                outputs[name] = toned[0]
        return outputs

    def _view_of(self, camera: Cameras, index: int | None) -> View:
        """The view of a camera; training views have the pose that the pose optimizer found."""
        assert camera.shape[0] == 1, "one camera at a time"
        pose = camera.camera_to_worlds
        if index is not None:
            camera.metadata = {**(camera.metadata or {}), "cam_idx": index}
            pose = self.camera_optimizer.apply_to_camera(camera)
        view = view_of(camera, pose[0], self._get_downscale_factor())
        self.last_size = (view.height, view.width)
        return view

    def _settings(self, depth: bool) -> RenderSettings:
        return RenderSettings(
            antialiased=self.config.rasterize_mode == "antialiased",
            depth=depth,
            absgrad=self.training and self.config.use_absgrad,
        )

    def _render_static(self, view: View) -> Rendering:
        crop = self.crop_box if not self.training else None
        keep = None if crop is None else crop.within(self.means).reshape(-1)
        depth = self.config.output_depth_during_training or not self.training
        splats = activate_static(self.gauss_params, self._sh_degree(), keep)
        rendering = self.rasterizer(splats, view, self._settings(depth))
        if self.training:
            self.info = strategy_info(rendering, view)
            self.strategy.step_pre_backward(
                self.gauss_params, self.optimizers, self.strategy_state, self.step, self.info
            )
        return rendering

    def _render_distractors(self, view: View, index: int | None) -> Rendering | None:
        """Distractors of training view `index`; None where there is nothing to draw."""
        self._distractors_drawn = None
        warming_up = self.training and self.step < self.config.distractors.static_warmup
        if self.distractors is None or index is None or warming_up:
            return None
        if self.distractors.count_of(index) == 0:
            return None
        splats = activate_distractors(self.distractors.params_of(index))
        rendering = self.rasterizer(splats, view, self._settings(depth=False))
        if self.training:
            info = strategy_info(rendering, view)
            self.densifier.before_backward(info)
            self._distractors_drawn = (index, info)
        return rendering

    def _sh_degree(self) -> int | None:
        if self.config.sh_degree == 0:
            return None
        return min(self.step // self.config.sh_degree_interval, self.config.sh_degree)

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

    def get_param_groups(self) -> dict[str, list[nn.Parameter]]:
        """Splatfacto's groups and one for each kind of distractor parameter."""
        groups = super().get_param_groups()
        return groups | (self.distractors.param_groups() if self.distractors is not None else {})

    def get_loss_dict(
        self, outputs: dict[str, Any], batch: dict[str, Any], metrics_dict: Any = None
    ) -> dict[str, Tensor]:
        """Eq. 5: Splatfacto's photometric loss on what was drawn, and the two opacity terms.

        docs/separation.md says what `distractors.start` and `static_alone` change.
        """
        losses = super().get_loss_dict(outputs, batch, metrics_dict)
        if not self.training or self.distractors is None:
            return losses
        config = self.config.distractors
        alpha_d, alpha_s = outputs["alpha_distractor"], outputs["accumulation"]
        photo = self.composite_with_background(
            self.get_gt_img(batch["image"]), outputs["background"]
        )
        free = None
        if config.start == "residual":
            seen = Sighting(*self.drawn, photo, alpha_d)
            opacities, state = self.gauss_params["opacities"], self.strategy_state
            static = outputs["rgb_static"]
            free = self.placement.look(self.step, seen, static, opacities, self.info, state)
        losses["distractor_opacity"] = config.lambda_d * distractor_opacity_loss(alpha_d, free)
        losses["static_transparency"] = config.lambda_s * static_transparency_loss(alpha_s)
        if config.static_alone and self._distractors_drawn is not None:
            owned = owned_share(alpha_d)
            if "mask" in batch:
                mask = self._downscale_if_required(batch["mask"]).to(owned.device)
                owned = owned.masked_fill(mask == 0, 1.0)
            losses["static_photometric"] = static_photometric_loss(
                outputs["rgb_static"], photo, owned, self.config.ssim_lambda
            )
        return losses

    def get_metrics_dict(self, outputs: dict[str, Any], batch: dict[str, Any]) -> dict[str, Any]:
        """Splatfacto's figures of a training step and the number of distractors."""
        metrics: dict[str, Any] = super().get_metrics_dict(outputs, batch)
        if self.distractors is not None:
            metrics["distractor_count"] = sum(self.distractors.counts())
        return metrics

    def step_post_backward(self, step: int) -> None:
        """Densify after an optimizer step: the static set, then the set of the view just seen."""
        super().step_post_backward(step)
        if self.num_points == 0:
            raise DeSplatError(
                f"At step {step} the last static Gaussian was pruned: nothing is left to train. "
                "The photos or their poses do not fit together, or a learning rate is too high."
            )
        if self._distractors_drawn is not None and self.distractors is not None:
            index, info = self._distractors_drawn
            self.distractors.keep_colors_in_range(index)
            self.densifier.after_step(self.distractors, index, self.optimizers, step, info)
        if self.distractors is not None:
            self.placement.place(self.distractors, self.densifier, self.optimizers)

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

    def get_extra_state(self) -> dict[str, Any]:
        """What a checkpoint holds besides parameters: densification's running statistics."""
        state: dict[str, Any] = {"static_strategy": dict(self.strategy_state)}
        if self.distractors is not None:
            state["densifier"] = self.densifier.state_dict()
        return state

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Take up what `get_extra_state` gave."""
        self.strategy_state = to_device(state["static_strategy"], self.device)
        if self.distractors is not None:
            self.densifier.load_state_dict(state["densifier"], self.device)

    def load_state_dict(self, dict: Any, **kwargs: Any) -> Any:
        """nn.Module's: Splatfacto's replaces the parameters that the optimizers hold."""
        return nn.Module.load_state_dict(self, dict, **kwargs)

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *args: Any) -> None:
        """torch's hook, called before the children load: take the saved number of Gaussians."""
        resize_rows(self.gauss_params, state_dict, f"{prefix}gauss_params.")
        super()._load_from_state_dict(state_dict, prefix, *args)
