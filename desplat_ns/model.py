"""DeSplat as a nerfstudio model: wiring; settings and formulas are elsewhere."""

from __future__ import annotations

from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor, nn

from desplat_ns.backend.contributions import contributions
from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.data.training_views import train_index, view_name
from desplat_ns.errors import DeSplatError, TrainingError
from desplat_ns.gaussians.activation import RawParameters, activate_distractors
from desplat_ns.gaussians.densification import DistractorDensifier, strategy_info, to_device
from desplat_ns.gaussians.distractors import DistractorGaussians
from desplat_ns.photo_tourism.background import background_opacity_loss, explained_by_background
from desplat_ns.rendering.layers import layered_outputs, static_outputs
from desplat_ns.separation.clearance import Clearance
from desplat_ns.separation.failure_cases import SeparationWatch
from desplat_ns.separation.ownership import owned_share
from desplat_ns.separation.placement import Placement
from desplat_ns.separation.visit import Sighting
from desplat_ns.static_model import StaticModel
from desplat_ns.training.culled import CulledCount, culled_always, too_many_culled
from desplat_ns.training.losses import (
    distractor_opacity_loss,
    static_photometric_loss,
    static_transparency_loss,
)
from desplat_ns.viewer import LayerControl


class DeSplatModel(StaticModel):
    """A static scene shared by all views, and distractor Gaussians for each training view."""

    distractors: DistractorGaussians | None

    def populate_modules(self) -> None:
        """The static scene, and distractors in front of every training camera."""
        super().populate_modules()
        self.distractors = None
        self.layer_control = LayerControl(0)
        self.names: list[str] = self.kwargs.get("metadata", {}).get("train_image_names", [])
        self.culled = CulledCount(self.num_train_data)
        self.losses: dict[str, Tensor] = {}
        self._step_dropped = False
        if self.config.effects.distractors:
            cameras: Cameras = self.kwargs["metadata"]["train_cameras"]
            self.distractors = DistractorGaussians(self.config.distractors, cameras)
            self.densifier = DistractorDensifier(
                self.config.distractors, self.config, self.num_train_data
            )
            self.placement = Placement(self.config.distractors, self.num_train_data)
            self.layer_control = LayerControl(self.num_train_data)
            seeds = None if self.config.random_init else self.seed_points
            points = None if seeds is None else seeds[0].to(cameras.device)
            self.clearance = Clearance(self.config.distractors.clearance, points, cameras)
            self.watch = SeparationWatch(self.config.distractors, self.names, self.num_train_data)
        self._distractors_drawn: tuple[int, dict[str, Any]] | None = None

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
            self._remembered, self._step_dropped = dict(self.strategy_state), False
        view = self.view_of_camera(camera, index)
        if index is None and not self.training:
            index = self.layer_control.train_idx()
        embedding = self.embedding_of(index)
        static = self.render_static(view, embedding)
        distractor = self._render_distractors(view, index)
        if self.training and index is not None:
            self.drawn = (index, view)
        background = self.background_of(view, embedding)
        outputs = static_outputs(static, background)
        if self.distractors is not None:
            outputs["rgb_static"] = outputs["rgb"]
            beneath, behind = static, background
            if self.training and distractor is not None and self.config.distractors.static_alone:
                beneath, behind = static.detached(), background.detach()
            outputs |= layered_outputs(beneath, distractor, behind)
        if not self.training:
            return self.layer_control.apply(outputs)
        if self.distractors is not None:
            outputs["rgb"] = outputs["rgb_composite"]
        if self.config.use_bilateral_grid and index is not None:
            for name in outputs.keys() & {"rgb", "rgb_static"}:
                toned = self._apply_bilateral_grid(outputs[name][None], index, *self.last_size)
                outputs[name] = toned[0]
        return outputs

    def _render_distractors(self, view: View, index: int | None) -> Rendering | None:
        """Distractors of training view `index`; None where there is nothing to draw."""
        self._distractors_drawn = None
        warming_up = self.training and self.step < self.config.distractors.static_warmup
        if self.distractors is None or index is None or warming_up:
            return None
        if self.distractors.count_of(index) == 0:
            return None
        splats = activate_distractors(self.distractors.params_of(index))
        rendering = self.rasterizer(splats, view, self.render_settings(depth=False))
        if self.training:
            info = strategy_info(rendering, view)
            self.densifier.before_backward(info)
            self._distractors_drawn = (index, info)
        return rendering

    def get_param_groups(self) -> dict[str, list[nn.Parameter]]:
        """The static scene's groups and one for each kind of distractor parameter."""
        groups = super().get_param_groups()
        if self.distractors is not None:
            groups |= self.distractors.param_groups()
        return groups

    def get_loss_dict(
        self, outputs: dict[str, Any], batch: dict[str, Any], metrics_dict: Any = None
    ) -> dict[str, Tensor]:
        """Eq. 5 and 12: Splatfacto's photometric loss on what was drawn, and the opacity terms.

        docs/separation.md says what `distractors.start` and `static_alone` change.
        """
        losses = super().get_loss_dict(outputs, batch, metrics_dict)
        if not self.training:
            return losses
        photo = self.composite_with_background(
            self.get_gt_img(batch["image"]), outputs["background"]
        )
        if self.distractors is not None:
            losses |= self._distractor_losses(outputs, batch, photo)
        if self.config.effects.background:
            losses["background_opacity"] = self._background_loss(outputs, batch, photo)
        self.losses = {name: value.detach() for name, value in losses.items()}
        return losses

    def _distractor_losses(
        self, outputs: dict[str, Any], batch: dict[str, Any], photo: Tensor
    ) -> dict[str, Tensor]:
        """The opacity terms of Eq. 5; with `static_alone` also the static scene's own term."""
        config, losses = self.config.distractors, {}
        alpha_d, alpha_s = outputs["alpha_distractor"], outputs["accumulation"]
        self.watch.see(self.step, *self.drawn, alpha_d)
        free = left_out = None
        if config.start == "residual":
            seen = Sighting(*self.drawn, photo, alpha_d)
            opacities, state = self.gauss_params["opacities"], self.strategy_state
            static = outputs["rgb_static"]
            free = self.placement.look(self.step, seen, static, opacities, self.info, state)
            left_out = seen.left_out
        losses["distractor_opacity"] = config.lambda_d * distractor_opacity_loss(alpha_d, free)
        losses["static_transparency"] = config.lambda_s * static_transparency_loss(alpha_s)
        if config.static_alone and self._distractors_drawn is not None:
            owned = owned_share(alpha_d, left_out)
            if "mask" in batch:
                mask = self._downscale_if_required(batch["mask"]).to(owned.device)
                owned = owned.masked_fill(mask == 0, 1.0)
            losses["static_photometric"] = static_photometric_loss(
                outputs["rgb_static"], photo, owned, self.config.ssim_lambda
            )
        return losses

    def _background_loss(
        self, outputs: dict[str, Any], batch: dict[str, Any], photo: Tensor
    ) -> Tensor:
        """The background's term of Eq. 12."""
        config, alpha_s = self.config.background, outputs["accumulation"]
        alpha_d = outputs.get("alpha_distractor", torch.zeros_like(alpha_s))
        explained = explained_by_background(outputs["background"], photo, config.max_error)
        if "mask" in batch:
            explained &= self._downscale_if_required(batch["mask"]).to(explained.device) != 0
        return config.lambda_bg * background_opacity_loss(alpha_d, alpha_s, explained)

    def get_metrics_dict(self, outputs: dict[str, Any], batch: dict[str, Any]) -> dict[str, Any]:
        """Splatfacto's figures of a training step, the number of distractors, and how many of both
        were culled in every view when last counted."""
        metrics: dict[str, Any] = super().get_metrics_dict(outputs, batch)
        metrics["culled_static"] = self.culled.static
        if self.distractors is not None:
            metrics["distractor_count"] = sum(self.distractors.counts())
            metrics["culled_distractors"] = self.culled.distractors
        return metrics

    def view_name(self) -> str:
        """The training photo of the step at hand."""
        return view_name(self.names, self.drawn[0])

    def drop_step(self) -> None:
        """Forget all that the step at hand left behind; `step_post_backward` then does nothing.

        A refinement or reset that was due falls out.
        """
        self.strategy_state.clear()
        self.strategy_state.update(self._remembered)
        self._step_dropped = True
        if self.distractors is not None:
            self.placement.forget()

    def gaussian_groups(self) -> set[str]:
        """Parameter groups with one row for each Gaussian."""
        groups = set(self.gauss_params.keys())
        return groups if self.distractors is None else groups | set(self.distractors.param_groups())

    @torch.no_grad()
    def culled_static(self) -> int:
        """Static Gaussians that no view shows, in the average light."""
        effects = self.image_effects
        embedding = None if effects is None else effects.embeddings.mean()
        return int(culled_always(self._splats(self.gauss_params, embedding)).sum())

    @torch.no_grad()
    def culled_distractors(self) -> int:
        """Distractors that their view cannot show."""
        if self.distractors is None:
            return 0
        views = range(self.num_train_data)
        splats = (activate_distractors(self.distractors.params_of(view)) for view in views)
        return sum(int(culled_always(one).sum()) for one in splats)

    def step_post_backward(self, step: int) -> None:
        """Densify after an optimizer step: the static set, then the set of the view just seen."""
        if self._step_dropped:
            return
        if self.distractors is not None:
            opacities = self.gauss_params["opacities"].data
            self.clearance.keep(*self.drawn, self.means, opacities, self.info)
        super().step_post_backward(step)
        if self.num_points == 0:
            raise DeSplatError(
                f"At step {step} the last static Gaussian was pruned: nothing is left to train. "
                "The photos or their poses do not fit together, or a learning rate is too high."
            )
        if self._distractors_drawn is not None and self.distractors is not None:
            index, info = self._distractors_drawn
            self.distractors.keep_colors_in_range(index)
            self.densifier.after_step(
                self.distractors, index, self.optimizers, step, info, self._pixels_of
            )
        if self.distractors is not None:
            self.placement.place(self.distractors, self.densifier, self.optimizers)
            self.watch.look(step, self.means)
        if step % self.culled.interval == 0:
            self._count_culled(step)

    def _pixels_of(self, params: RawParameters) -> Tensor:
        """Contributions [N] of distractors of the view just drawn, in pixels of its full size."""
        _, view = self.drawn
        settings = self.render_settings(depth=False)
        drawn = contributions(self.rasterizer, activate_distractors(params), view, settings)
        return drawn * self._get_downscale_factor() ** 2

    def _count_culled(self, step: int) -> None:
        """Raises TrainingError where most static Gaussians are culled in every view."""
        self.culled.take(step, self.culled_static(), self.culled_distractors())
        found = too_many_culled(self.culled.static, self.num_points)
        if found is not None:
            raise TrainingError(
                f"At step {step} {found}. A learning rate is too high: give a lower "
                "--optimizers.GROUP.optimizer.lr. Checkpoints saved before are untouched; "
                "`--load-dir` goes on from the newest."
            )

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
