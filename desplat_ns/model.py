"""DeSplat as a nerfstudio model: settings and wiring; formulas are elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor, nn
from torch.optim import Optimizer

from desplat_ns.backend.accumulated_weights import accumulated_weights
from desplat_ns.backend.protocol import Rendering, Splats, View
from desplat_ns.console import list_names
from desplat_ns.data.training_views import train_index, view_name
from desplat_ns.errors import DeSplatError
from desplat_ns.gaussians.activation import RawParameters, activate_distractors
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import DistractorGaussians, to_device
from desplat_ns.photo_tourism.background import background_opacity_loss, explained_by_background
from desplat_ns.rendering.layers import layered_outputs, static_outputs
from desplat_ns.rendering.views import held
from desplat_ns.separation.layer import DistractorLayer, TrainStep
from desplat_ns.static_model import StaticModel, StaticModelConfig
from desplat_ns.training.culled import culled_always
from desplat_ns.training.run_length import photo_downscale
from desplat_ns.viewer import LayerControl


@dataclass
class DeSplatModelConfig(StaticModelConfig):
    """A static scene, and distractors in front of it."""

    _target: type = field(default_factory=lambda: DeSplatModel)
    distractors: DistractorConfig = field(default_factory=DistractorConfig)
    """Distractor Gaussians."""

    def for_run(self, num_views: int) -> DeSplatModelConfig:
        """As `StaticModelConfig`'s; the distractors' steps follow."""
        run = super().for_run(num_views)
        run.distractors = self.distractors.for_views(
            num_views, run.warmup_length, self.schedule_scale or 1.0
        )
        return run

    def warmup_of(self, num_views: int) -> tuple[int, int]:
        """`DistractorConfig.warmup_of` a run; no steps without distractors."""
        if not self.effects.settled().distractors:
            return 0, 0
        scale = self.schedule_scale or 1.0
        return self.distractors.warmup_of(num_views, self.warmup_length, scale)

    def downscale_factor(self, step: int) -> int:
        """As `StaticModelConfig`'s; with a warm-up, small photos are over by the middle of it."""
        warmup = self.distractors.static_warmup if self.effects.settled().distractors else 0
        usual = photo_downscale(step, self.num_downscales, self.resolution_schedule, warmup)
        return max(self.train_downscale, usual)


class DeSplatModel(StaticModel):
    """A static scene shared by all views, and distractor Gaussians for each training view."""

    config: DeSplatModelConfig
    distractors: DistractorGaussians | None
    """The parameters, where checkpoints look for them."""

    def populate_modules(self) -> None:
        """The static scene, and distractors in front of every training camera."""
        super().populate_modules()
        self.names: list[str] = self.kwargs.get("metadata", {}).get("train_image_names", [])
        self.losses: dict[str, Tensor] = {}
        self.train_step: TrainStep | None = None
        """The step at hand; None if there is none, or if it was dropped."""
        self.is_logged = True
        """Whether anybody is told the figures of the step at hand."""
        self.distractors, self.layer = None, None
        if self.effects.distractors:
            self.layer = self._make_layer()
            self.distractors = self.layer.gaussians
        num_views = 0 if self.layer is None else self.num_train_data
        angle = (lambda view: self.photo_angle.degrees(view)) if self.has_points else None
        self.layer_control = LayerControl(num_views, self.config.near_plane, angle)

    def _make_layer(self) -> DistractorLayer:
        cameras: Cameras = self.kwargs["metadata"]["train_cameras"]
        config, points = self.config.distractors, None
        if self.has_points:
            assert self.seed_points is not None
            points = self.seed_points[0].to(cameras.device)
        gaussians = DistractorGaussians(config, cameras)
        background = self.effects.background
        scale = self.config.schedule_scale or 1.0
        return DistractorLayer(gaussians, config, self.config, cameras, points, background, scale)

    # --- drawing -----------------------------------------------------------------------------

    def get_outputs(self, camera: Cameras) -> dict[str, Tensor]:
        """Render one camera.

        Returns:
            Images [H, W, C] with colours in [0, 1]: rgb (in training what the loss sees, else the
            static scene), depth (world units; not in training), accumulation, background; with
            distractors also rgb_static, rgb_composite, rgb_distractor (weighted by its alpha),
            alpha_distractor and distractor_mask (bool).
        """
        index = train_index(camera)
        if self.training:
            assert index is not None, "a camera to train on says which training view it is"
            return self._training_outputs(camera, index)
        view = self.view_of_camera(camera, index)
        if index is None:
            index = self.layer_control.train_idx()
        self.layer_control.tell_photo_angle(view)
        embedding = self.embedding_of(index)
        static = self.render_static(view, embedding)
        background = self.background_of(view, embedding)
        image = self.image_of(static, background, view, embedding)
        background = self.apply_camera_response(background, view, embedding).clamp(0, 1)
        outputs = static_outputs(static, image, background)
        if self.layer is not None:
            outputs["rgb_static"] = outputs["rgb"]
            drawn = None if index is None else self.layer.draw(index, self._rasterizer_of(view))
            outputs |= layered_outputs(image, outputs["rgb"], drawn)
        return self.layer_control.chosen(outputs)

    def _training_outputs(self, camera: Cameras, index: int) -> dict[str, Tensor]:
        """As `get_outputs`; begins the `TrainStep`."""
        view, embedding = self.view_of_camera(camera, index), self.embedding_of(index)
        static = self.render_static(view, embedding)
        self.train_step = train_step = TrainStep(self.nominal_step, index, view, static)
        if self.layer is not None:
            rasterize = self._rasterizer_of(held(view))  # poses are the static scene's to learn
            drawn = self.layer.draw_for_training(self.nominal_step, index, rasterize)
            train_step.distractors = drawn
        background = self.background_of(view, embedding)
        image = self.image_of(static, background, view, embedding)
        outputs = static_outputs(static, image, background)
        if self.layer is not None:
            outputs["rgb_static"] = outputs["rgb"]
            outputs |= self.layer.training_outputs(train_step, image, outputs["rgb"])
            outputs["rgb"] = outputs["rgb_composite"]
        if self.config.use_bilateral_grid:
            for name in outputs.keys() & {"rgb", "rgb_static"}:
                toned = self._apply_bilateral_grid(outputs[name][None], index, *self.last_size)
                outputs[name] = toned[0]
        return outputs

    def near_plane_share(self) -> float:
        """As the viewer says."""
        return self.layer_control.near_plane_share()

    def _rasterizer_of(self, view: View) -> Callable[[Splats], Rendering]:
        """Draws distractors into a view."""
        settings = self.render_settings(depth=False)
        return lambda splats: self.rasterizer(splats, view, settings)

    def view_optimizers(self) -> dict[str, Optimizer]:
        """Those of the distractors that the step at hand drew, beside nerfstudio's, which hold what
        all views share."""
        train_step = self.train_step
        if self.layer is None or train_step is None:
            return {}
        return self.layer.optimizers_of(train_step)

    def view_parameters(self) -> dict[str, list[nn.Parameter]]:
        """The distractors of all views, by kind."""
        return {} if self.distractors is None else self.distractors.param_groups()

    def trained_bytes(self) -> int:
        """Of all parameters, those of every view among them, with Adam's two moments of each."""
        groups = self.get_param_groups() | self.view_parameters()
        return sum(3 * p.numel() * p.element_size() for group in groups.values() for p in group)

    # --- losses ------------------------------------------------------------------------------

    def get_loss_dict(
        self, outputs: dict[str, Any], batch: dict[str, Any], metrics_dict: Any = None
    ) -> dict[str, Tensor]:
        """Eq. 5 and 12: the photometric loss of what was drawn, and the opacity terms.

        docs/results/separation.md says what `distractors.start` and `static_alone` change.
        """
        if not self.training:
            return super().get_loss_dict(outputs, batch, metrics_dict)
        if self.effects.background != "off" or batch["image"].shape[2] == 4:
            outputs = {**outputs, "background": self._photographed_background(outputs)}
        photo = self.photo_of(outputs, batch)
        mask = self.mask_of(batch, photo.device)
        losses: dict[str, Tensor] = {}
        if self.layer is not None:
            losses |= self._distractor_losses(self.layer, outputs, photo, mask)
        if "main_loss" not in losses:
            losses["main_loss"] = self.photometric_term(outputs["rgb"], photo, mask)
        if self.effects.background != "off":
            losses["background_opacity"] = self._background_loss(outputs, photo, mask)
        losses |= self.regularizers()
        self.losses = {name: value.detach() for name, value in losses.items()}
        return losses

    def _distractor_losses(
        self, layer: DistractorLayer, outputs: dict[str, Any], photo: Tensor, mask: Tensor | None
    ) -> dict[str, Tensor]:
        """The layer's terms; the `TrainStep` is filled in."""
        train_step = self.train_step
        assert train_step is not None
        train_step.photo, train_step.static_rgb = photo, outputs["rgb_static"]
        train_step.composite, train_step.alpha_d = outputs["rgb"], outputs["alpha_distractor"]
        opacities, alpha_s = self.gauss_params["opacities"], outputs["accumulation"]
        return layer.losses(train_step, alpha_s, opacities, self.memory, mask)

    def _photographed_background(self, outputs: dict[str, Any]) -> Tensor:
        """What the step's photo shows behind everything: what a transparent pixel of it shows."""
        train_step = self.train_step
        assert train_step is not None
        embedding = self.embedding_of(train_step.index)
        background, view = outputs["background"], train_step.view
        return self.apply_camera_response(background, view, embedding).clamp(0, 1)

    def _background_loss(
        self, outputs: dict[str, Any], photo: Tensor, mask: Tensor | None
    ) -> Tensor:
        """The background's term of Eq. 12."""
        config, alpha_s = self.config.background, outputs["accumulation"]
        alpha_d = outputs.get("alpha_distractor", torch.zeros_like(alpha_s))
        explained = explained_by_background(outputs["background"], photo, config.max_error)
        if mask is not None:
            explained &= mask
        return config.lambda_bg * background_opacity_loss(alpha_d, alpha_s, explained)

    def get_metrics_dict(self, outputs: dict[str, Any], batch: dict[str, Any]) -> dict[str, Any]:
        """Splatfacto's figures, and the number of distractors; none of a training step that is not
        logged."""
        if self.training and not self.is_logged:
            return {}
        metrics: dict[str, Any] = super().get_metrics_dict(outputs, batch)
        if self.distractors is not None:
            metrics["distractor_count"] = self.distractors.total
        return metrics

    def photos_with_distractors(self) -> list[str]:
        """Names of the training photos in which something was found in the way."""
        counts = [] if self.distractors is None else self.distractors.counts()
        return [view_name(self.names, index) for index, count in enumerate(counts) if count > 0]

    def found_in_the_way(self) -> list[str]:
        """A line that says in which photos; none without distractors."""
        if self.distractors is None:
            return []
        names = self.photos_with_distractors()
        found = f"Distractors in {len(names)} of {len(self.distractors.views)} photos"
        return [f"{found}: {list_names(names, 8)}." if names else f"{found}."]

    # --- after a step ------------------------------------------------------------------------

    def view_name(self) -> str:
        """The training photo of the step at hand."""
        train_step = self.train_step
        return "an unknown photo" if train_step is None else view_name(self.names, train_step.index)

    def drop_step(self) -> None:
        """Throw the step at hand away: `step_post_backward` then does nothing, and nothing of it is
        remembered. A refinement or reset that was due follows at the next one."""
        self.train_step = None

    def step_post_backward(self, step: int) -> None:
        """Densify after an optimizer step: the static set, then the set of the view just seen."""
        train_step = self.train_step
        if train_step is None:
            return
        if self.layer is None:
            self._refine_static(step)
        else:
            self.layer.commit(
                train_step,
                self.gauss_params,
                self.memory,
                lambda: self._refine_static(step),
                self._weights_of,
            )
        self.train_step = None

    def _refine_static(self, step: int) -> None:
        """Splatfacto's refinements and resets, and what was cleared away.

        Raises DeSplatError where no static Gaussian is left.
        """
        super().step_post_backward(step)
        strategy = self.strategy
        if self.nominal_step >= strategy.refine_stop_iter and step % strategy.refine_every == 0:
            self.sweep()
        if self.num_points == 0:
            raise DeSplatError(
                f"At step {step} the last static Gaussian was pruned: nothing is left to train. "
                "The photos or their poses do not fit together, or a learning rate is too high."
            )

    def sweep(self) -> None:
        """Remove static Gaussians that were cleared away since the last refinement."""
        if self.layer is not None:
            clearance = self.layer.clearance
            clearance.sweep(self.gauss_params, self.optimizers, self.strategy_state)

    def _weights_of(self, params: RawParameters) -> Tensor:
        """Contributions [N] of distractors of the view just drawn, in pixels of its full size."""
        assert self.train_step is not None
        settings = self.render_settings(depth=False)
        splats = activate_distractors(params)
        drawn = accumulated_weights(self.rasterizer, splats, self.train_step.view, settings)
        return drawn * self._get_downscale_factor() ** 2

    def gaussian_groups(self) -> set[str]:
        """Parameter groups with one row for each Gaussian."""
        return set(self.gauss_params.keys())

    @torch.no_grad()
    def culled_static(self) -> int:
        """Static Gaussians that no view shows, in the average light."""
        embedding = self.average_embedding() if self.image_effects is not None else None
        return int(culled_always(self._splats(self.gauss_params, embedding)).sum())

    def get_extra_state(self) -> dict[str, Any]:
        """What a checkpoint holds besides parameters: densification's running statistics."""
        state: dict[str, Any] = {"static_strategy": dict(self.strategy_state)}
        if self.layer is not None:
            state["regions"] = dict(self.layer.regions)
            state["photos"] = self.layer.witnesses.state()
        return state

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Take up what `get_extra_state` gave."""
        self.strategy_state = to_device(state["static_strategy"], self.device)
        if self.layer is not None:
            self.layer.regions = to_device(state["regions"], self.device)
            self.layer.witnesses.load(state["photos"])
