"""DeSplat as a nerfstudio model: a static scene, and distractors for each training view."""

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.model_components.lib_bilagrid import color_correct, total_variation_loss
from nerfstudio.models.splatfacto import SH2RGB, SplatfactoModel
from torch import Tensor, nn
from torch.optim import Optimizer

from desplat_ns.backend import Rasterizer, resolve
from desplat_ns.backend.accumulated_weights import accumulated_weights
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from desplat_ns.cameras.near_plane import sampled, scene_start, stands_clear
from desplat_ns.cameras.views import reduced, resized, view_of
from desplat_ns.core.console import list_names
from desplat_ns.core.devices import state_to_device
from desplat_ns.core.effects import Effects
from desplat_ns.core.errors import BackendUnavailableError, CaptureError, DeSplatError
from desplat_ns.core.schedule import SPLATFACTOS_INTERVAL, NominalStep, RunStep, Schedule
from desplat_ns.data.images import resize_image
from desplat_ns.data.point_cloud import distinct
from desplat_ns.data.training_views import train_index, view_name
from desplat_ns.distractors.config import rates_at
from desplat_ns.distractors.distractors import Distractors
from desplat_ns.gaussians.activation import RawParameters, activate_distractors, activate_static
from desplat_ns.gaussians.strategy import StaticStrategy
from desplat_ns.image_losses import image_losses, main_loss
from desplat_ns.layers import layered_outputs, over_background, static_outputs
from desplat_ns.losses import camera_response_loss, mean_shown_opacity
from desplat_ns.metrics import LazyLpips, image_metrics
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.photo_tourism.appearance import as_harmonics, fourier_features
from desplat_ns.photo_tourism.background import BACKGROUND_DEGREE_INTERVAL
from desplat_ns.photo_tourism.image_effects import FEATURES, ImageEffects
from desplat_ns.photo_tourism.shown_light import ShownLight
from desplat_ns.plugin import (
    splatfacto_modules_without_cuda,
    splatfacto_modules_without_torchmetrics,
)
from desplat_ns.separation.residuals import cells_of
from desplat_ns.step import Step
from desplat_ns.viewer import LayerControl

MIN_SEED_POINTS = 4
"""Splatfacto sizes each Gaussian by its three nearest neighbours; they may not be at one place."""


class DeSplatModel(SplatfactoModel):
    """A static scene shared by all views, and distractor Gaussians for each training view."""

    config: DeSplatModelConfig
    lpips: LazyLpips  # pyright: ignore[reportIncompatibleVariableOverride]
    effects: Effects
    """Those of this model, all decided."""
    image_effects: ImageEffects
    distractors: Distractors | None
    """Those of all training views; None in a model without any."""
    schedule = Schedule()
    """Of the run: all that changes with its steps is in its nominal steps."""
    train_step: Step | None = None
    """The step at hand, between nerfstudio's calls; None if there is none, or if it was dropped."""

    def populate_modules(self) -> None:
        """Static Gaussians at the 3D points, what the effects need, and distractors in front of
        every training camera."""
        if self.config.random_init:
            self.seed_points = None
        if self.seed_points is not None:
            points, colors = self.seed_points
            rows = torch.from_numpy(distinct(points.detach().cpu().numpy()))
            self.seed_points = (points[rows], colors[rows])
            if len(rows) < MIN_SEED_POINTS:
                raise CaptureError(
                    f"The capture has {len(rows)} 3D points at different places; static Gaussians "
                    f"start at the points of the reconstruction and need at least "
                    f"{MIN_SEED_POINTS}. Give a reconstruction with points, or add "
                    "`--pipeline.model.random-init True`."
                )
        self.config = config = self.config.for_run(self.num_train_data)
        self.schedule = Schedule(config.schedule_scale or 1.0)
        self.effects = config.effects.settled()
        self._views: dict[int, View] = {}
        """Of training, in full size, where poses stay: a GPU's cameras would be waited for."""
        self.names: list[str] = self.kwargs.get("metadata", {}).get("train_image_names", [])
        with splatfacto_modules_without_torchmetrics(), splatfacto_modules_without_cuda(self):
            super().populate_modules()
        cameras: Cameras = self.kwargs["metadata"]["train_cameras"]
        num_views, scale, effects = self.num_train_data, self.schedule.scale, self.effects
        pixels = int((cameras.width * cameras.height).sum())
        smaller = config.downscale_factor(0, pixels // num_views) if config.first_megapixels else 1
        # After a reset of the opacities the scene recovers, as in Splatfacto, for a round of the
        # views and 100 steps of the run: these are nominal steps, at most half of `reset_every`.
        pause = round((num_views + SPLATFACTOS_INTERVAL) / scale)
        settings = {
            "grow_grad2d": config.densify_grad_thresh / math.sqrt(smaller),
            "reset_every": config.reset_every,
            "pause_refine_after_reset": min(pause, config.reset_every // 2),
            "verbose": False,
            "most": config.most_gaussians(pixels, self.kwargs.get("device", "cpu")),
            "long_axis_split": config.long_axis_split,
            "cull_to_the_end": config.cull_to_the_end,
        }
        self.strategy = StaticStrategy(**vars(self.strategy) | settings)
        self.image_effects = ImageEffects(effects, config.appearance, num_views, config.sh_degree)
        if self.image_effects.appearance is not None:
            features = fourier_features(self.means.detach())
            self.gauss_params[FEATURES] = nn.Parameter(features)
        self.shown_light = ShownLight(self.names if effects.image_light else [])
        self.distractors = None
        if effects.distractors:
            seeds = None if self.seed_points is None else self.seed_points[0].to(cameras.device)
            self.distractors = Distractors(
                config.distractors, config, cameras, seeds, effects.background, scale
            )
        views = range(num_views if effects.distractors else 0)
        shown = [view_name(self.names, index) for index in views]
        self.layer_control = LayerControl(shown)

    @cached_property
    def rasterizer(self) -> Rasterizer:
        """The backend. Raises BackendUnavailableError in training, if it cannot run here; what was
        trained elsewhere is rendered with what there is."""
        try:
            return resolve(self.config.backend, self.device.type)
        except BackendUnavailableError:
            if self.training:
                raise
            return resolve("auto", self.device.type)

    def get_param_groups(self) -> dict[str, list[nn.Parameter]]:
        """Splatfacto's groups and those of the effects."""
        groups = super().get_param_groups() | self.image_effects.param_groups()
        if FEATURES in self.gauss_params:
            groups[FEATURES] = [self.gauss_params[FEATURES]]
        return groups

    def view_optimizers(self) -> dict[str, Optimizer]:
        """That of the distractors that the step at hand drew; all else is nerfstudio's."""
        step = self.train_step
        if self.distractors is None or step is None or step.distractors is None:
            return {}
        return {"distractors": self.distractors.views[step.index].optimizer}

    # --- a step ------------------------------------------------------------------------------

    def get_outputs(self, camera: Cameras) -> dict[str, Tensor]:
        """Render one camera: the images of `static_outputs`, with distractors also rgb_static and
        those of `layered_outputs`. rgb is the static scene, in training what the loss sees. In
        training this begins the `Step`, and there is no depth."""
        index = train_index(camera)
        view = self.view_of_camera(camera, index)
        if index is None and not self.training:
            index = self.layer_control.train_idx()
        embedding = self.embedding_of(index)
        static = self.render_static(view, embedding)
        if self.training:
            assert index is not None, "a camera to train on says which training view it is"
            distractors = self._begin_step(index, view, static).distractors
        else:
            distractors = self.draw_distractors(index, view)
        background = self.background_of(view, embedding)
        image = self.image_of(static, background, view, embedding)
        if not self.training:
            background = self._photographed(background, view, embedding)
        outputs = static_outputs(static, image, background)
        if self.distractors is not None:
            outputs["rgb_static"] = outputs["rgb"]
            # The composite's loss moves distractors only: what lies beneath them is a constant.
            alone = self.distractors.config.static_alone and distractors is not None
            beneath = image.detach() if alone else image
            outputs |= layered_outputs(beneath, outputs["rgb"], distractors)
        if not self.training:
            return self.layer_control.chosen(outputs)
        if self.distractors is not None:
            outputs["rgb"] = outputs["rgb_composite"]
        if self.config.use_bilateral_grid and index is not None:
            for name in outputs.keys() & {"rgb", "rgb_static"}:
                image, size = outputs[name][None], (view.height, view.width)
                outputs[name] = self._apply_bilateral_grid(image, index, *size)[0]
        return outputs

    def _begin_step(self, index: int, view: View, static: Rendering) -> Step:
        """The step that draws a training view, with its distractors."""
        self.train_step = step = Step(self.nominal_step, RunStep(self.step), index, view, static)
        static.means2d.retain_grad()  # densification reads it, and that of the distractors
        if self.distractors is not None and step.nominal >= self.distractors.config.warmup:
            self.distractors.views[index].begin_step(rates_at(step.nominal))
            # Poses are the static scene's to learn.
            fixed = View(view.viewmat.detach(), view.K.detach(), view.width, view.height)
            step.distractors = self.draw_distractors(index, fixed)
            if step.distractors is not None:
                step.distractors.means2d.retain_grad()
        return step

    def get_loss_dict(
        self, outputs: dict[str, Any], batch: dict[str, Any], metrics_dict: Any = None
    ) -> dict[str, Tensor]:
        """The terms of the loss; outside of training those of the static scene."""
        if not self.training:
            photo = self.photo_of(outputs["background"], batch["image"])
            mask = self.mask_of(batch, photo.device)
            return {"main_loss": main_loss(outputs["rgb"], photo, mask, self.config)}
        step = self.train_step
        assert step is not None
        self._compare(step, outputs, batch)
        losses = image_losses(step, outputs, self.config, self.effects)
        losses |= self.regularizers(step, losses["main_loss"])
        step.losses = {name: value.detach() for name, value in losses.items()}
        return losses

    def _compare(self, step: Step, outputs: dict[str, Any], batch: dict[str, Any]) -> None:
        """Bring a step's images together with its photo, and find its regions, if that is due."""
        own, behind = self.distractors, outputs["background"]
        looks = own is not None and own.looks(step)
        if looks or self.effects.background != "off" or batch["image"].shape[2] == 4:
            behind = self._photographed(behind, step.view, self.embedding_of(step.index))
        step.behind, step.photo = behind, self.photo_of(behind, batch["image"])
        step.mask = self.mask_of(batch, step.photo.device)
        if own is not None:
            step.static_rgb = outputs["rgb_static"]
            own.look(step, self.gauss_params["opacities"], self.strategy_state)

    def regularizers(self, step: Step, main_loss: Tensor) -> dict[str, Tensor]:
        """What a step is charged beside its images: poses, responses, grids, Gaussians."""
        config, losses = self.config, dict[str, Tensor]()
        responses = self.image_effects.responses
        if responses is not None:
            prior = camera_response_loss(responses[step.index], responses.mean(dim=0), main_loss)
            losses["camera_response"] = prior
        if config.use_scale_regularization and self.step % 10 == 0:  # as nerfstudio 1.1.5
            scales = torch.exp(self.scales)
            ratio = scales.amax(dim=-1) / scales.amin(dim=-1)
            too_long = (ratio - config.max_gauss_ratio).clamp(min=0)
            losses["scale_reg"] = 0.1 * too_long.mean()
        self.camera_optimizer.get_loss_dict(losses)
        if config.use_bilateral_grid:
            losses["tv_loss"] = 10 * total_variation_loss(self.bil_grids.grids)
        if config.opacity_prior > 0:
            weight, shown = config.opacity_prior / self.num_train_data, step.static.visible
            if step.mask is not None:  # Gaussians whose centres lie in pixels that count
                means2d = step.static.means2d.detach()[0]
                shown, _ = cells_of(means2d, shown, step.mask.shape[:2], step.mask[..., 0])
            losses["opacity_prior"] = weight * mean_shown_opacity(self.opacities, shown)
        return losses

    def _photographed(self, background: Tensor, view: View, embedding: Tensor) -> Tensor:
        """What a photo shows behind everything, in [0, 1]."""
        return self.image_effects.apply_camera_response(background, view, embedding).clamp(0, 1)

    def photo_of(self, background: Tensor, image: Tensor) -> Tensor:
        """The photo [H, W, 3] of an image at the step's size; where it is transparent it shows the
        background."""
        return self.composite_with_background(self.get_gt_img(image), background)

    def get_gt_img(self, image: Tensor) -> Tensor:
        """A photo [H, W, C] in [0, 1] at the step's size; on a CPU 8 bit ones are reduced as such,
        without the colours of what is transparent."""
        if image.is_cpu and image.dtype == torch.uint8:
            size = self._size_at_hand(image.shape[1], image.shape[0])
            small = torch.from_numpy(resize_image(image.numpy(), *size)).to(self.device)
        else:
            small = self._downscale_if_required(image).to(self.device)
        return small.float() / 255.0 if image.dtype == torch.uint8 else small

    def mask_of(self, batch: dict[str, Any], device: torch.device) -> Tensor | None:
        """The user's mask [H, W, 1], True in the pixels of which at least half counts, if any."""
        if "mask" not in batch:
            return None
        return (self._downscale_if_required(batch["mask"].float()) >= 0.5).to(device)

    def _downscale_if_required(self, image: Tensor) -> Tensor:
        """An image [H, W, C] at the step's size, where it is smaller by area; Splatfacto's hook."""
        height, width = image.shape[:2]
        size = self._size_at_hand(width, height)
        return image if size == (width, height) else reduced(image, size)

    def step_post_backward(self, step: int) -> None:
        """Commit the step at hand after the optimizers': densify the static set, then the set of
        the view just seen. Raises DeSplatError where no static Gaussian is left."""
        done, self.train_step = self.train_step, None
        if done is None:
            return
        if self.distractors is not None:
            self.distractors.remember(done, self.strategy_state)
        held = self.gauss_params, self.optimizers, self.strategy_state
        self.strategy.after_step(*held, self.nominal_step, done.static)
        self.image_effects.after_step()
        if self.num_points == 0:
            raise DeSplatError(
                f"At step {step} the last static Gaussian was pruned: nothing is left to train. "
                "The photos or their poses do not fit together, or a learning rate is too high."
            )
        if self.distractors is not None:
            self.distractors.commit(done, partial(self._weights_of, done))

    def _weights_of(self, step: Step, params: RawParameters) -> Tensor:
        """Contributions [N] of distractors of a step's view, in pixels of its full size."""
        settings, view = self.render_settings(depth=False), step.view
        drawn = accumulated_weights(self.rasterizer, activate_distractors(params), view, settings)
        camera = self.kwargs["metadata"]["train_cameras"][step.index]
        return drawn * (int(camera.width) * int(camera.height) / (view.width * view.height))

    @torch.no_grad()  # torch warns where numbers with a gradient are logged
    def get_metrics_dict(self, outputs: dict[str, Any], batch: dict[str, Any]) -> dict[str, Any]:
        """Splatfacto's figures, and the number of distractors."""
        metrics: dict[str, Any] = super().get_metrics_dict(outputs, batch)
        if self.distractors is not None:
            metrics["distractor_count"] = sum(self.distractors.counts())
        return metrics

    # --- what is drawn -----------------------------------------------------------------------

    def view_of_camera(self, camera: Cameras, index: int | None) -> View:
        """The view of a camera; training views have the pose that the pose optimizer found."""
        assert camera.shape[0] == 1, "one camera at a time"
        if self.training and index is not None and self.camera_optimizer.config.mode == "off":
            if index not in self._views:
                self._views[index] = view_of(camera)
            view = self._views[index]
        else:
            pose = camera.camera_to_worlds
            if index is not None:
                camera.metadata = {**(camera.metadata or {}), "cam_idx": index}
                pose = self.camera_optimizer.apply_to_camera(camera)
            view = view_of(camera, pose[0])
        return resized(view, self._size_at_hand(view.width, view.height))

    def _size_at_hand(self, width: int, height: int) -> tuple[int, int]:
        """Width and height in which a photo of a size is trained on in the step at hand."""
        if not self.training:
            return width, height
        factor = self.config.downscale_factor(self.nominal_step, width * height)
        return max(1, round(width / factor)), max(1, round(height / factor))

    def render_settings(self, depth: bool) -> RenderSettings:
        return RenderSettings(
            antialiased=self.config.rasterize_mode == "antialiased",
            depth=depth,
            absgrad=self.training and self.config.use_absgrad,
        )

    @property
    def nominal_step(self) -> NominalStep:
        """Where schedules are in the step at hand."""
        return self.schedule.nominal(RunStep(self.step))

    @property
    def active_sh_degree(self) -> int | None:
        """Degree of the harmonics that are learned by now; None where colours have none."""
        if self.config.sh_degree == 0:
            return None
        return min(self.nominal_step // self.config.sh_degree_interval, self.config.sh_degree)

    def render_static(self, view: View, embedding: Tensor) -> Rendering:
        depth = self.config.output_depth_during_training or not self.training
        splats = self.in_light(self.params_in(view), view)(embedding)
        return self.rasterizer(splats, view, self.render_settings(depth))

    def draw_distractors(self, index: int | None, view: View) -> Rendering | None:
        """Those of a training view; None where it has none."""
        if self.distractors is None or index is None:
            return None
        own = self.distractors.views[index]
        if len(own) == 0:
            return None
        settings = self.render_settings(depth=False)
        return self.rasterizer(activate_distractors(own.params), view, settings)

    def params_in(self, view: View) -> RawParameters:
        """All in training; else those in the crop box that do not stand before the camera."""
        if self.training:
            return self.gauss_params
        keep = []
        if self.crop_box is not None:
            keep.append(self.crop_box.within(self.means).reshape(-1))
        share, points = self.config.near_plane, self.points
        if share > 0 and points is not None:
            start, shape = scene_start(points, view), (self.means, self.quats, self.scales.exp())
            keep.append(stands_clear(*shape, view, start, share))
        if not keep:
            return self.gauss_params
        shown = torch.stack(keep).all(dim=0)
        return {name: value[shown] for name, value in self.gauss_params.items()}

    @cached_property
    def points(self) -> Tensor | None:
        """A sample of the reconstruction's [P, 3]; None if the scene did not start from them."""
        return None if self.seed_points is None else sampled(self.seed_points[0]).to(self.device)

    # --- the light of an image ---------------------------------------------------------------

    def embedding_of(self, index: int | None) -> Tensor:
        """The image embedding [E] to draw with: in training that of view `index`; else the one
        chosen to be shown, that of view `index`, or the average of all."""
        if self.training and index is not None:
            return self.image_effects.of(index)
        return self.shown_light.embedding(self.image_effects, index)

    def background_of(self, view: View, embedding: Tensor) -> Tensor:
        """Colours [3], or [H, W, 3] where they differ or nerfstudio's commands expect them."""
        if self.image_effects.background is not None:
            degree = self.nominal_step // BACKGROUND_DEGREE_INTERVAL
            return self.image_effects.background_of(embedding, view, degree)
        color = self._get_background_color()
        return color if self.training else color.expand(view.height, view.width, 3)

    def image_of(
        self, static: Rendering, background: Tensor, view: View, embedding: Tensor
    ) -> Tensor:
        """The static scene over the background [H, W, 3], as the image's camera shows it; colours
        may be beyond 1."""
        image = over_background(static.rgb, static.alpha, background)
        return self.image_effects.apply_camera_response(image, view, embedding)

    def in_light(self, params: RawParameters, view: View) -> Callable[[Tensor], Splats]:
        """Static Gaussians in the colours of an embedding [E], for what `view` shows of them."""
        splats = activate_static(params, self.active_sh_degree)
        appearance = self.image_effects.appearance
        if appearance is None:
            return lambda embedding: splats
        return appearance.in_view(splats, params[FEATURES], view)

    # --- what others ask ---------------------------------------------------------------------

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

    def get_image_metrics_and_images(
        self, outputs: dict[str, Tensor], batch: dict[str, Any]
    ) -> tuple[dict[str, float], dict[str, Tensor]]:
        """Figures of one evaluation image, and the photo beside the rendering."""
        photo = self.photo_of(outputs["background"], batch["image"])
        figures = image_metrics(outputs["rgb"], photo, self.lpips)
        if self.config.color_corrected_metrics:
            corrected = image_metrics(color_correct(outputs["rgb"], photo), photo, self.lpips)
            figures |= {f"cc_{name}": value for name, value in corrected.items()}
        return figures, {"img": torch.cat([photo, outputs["rgb"]], dim=1)}

    @torch.no_grad()
    def shown_splats(self, rows: Tensor | None = None) -> Splats:
        """The static Gaussians, or some rows of them, in the light that is shown, for a file."""
        params: RawParameters = self.gauss_params
        if rows is not None:
            params = {name: value[rows] for name, value in params.items()}
        splats = activate_static(params, self.active_sh_degree)
        if FEATURES not in params:
            return splats
        light = self.embedding_of(None)
        return self.image_effects.apply_appearance(splats, params[FEATURES], light)

    @property
    def shs_0(self) -> Tensor:
        """Zeroth SH coefficients [N, 3] that `ns-export` writes, in the light that is shown."""
        return as_harmonics(self.shown_splats()).colors[:, 0]

    @property
    def shs_rest(self) -> Tensor:
        """The other SH coefficients [N, K - 1, 3] that `ns-export` writes."""
        return as_harmonics(self.shown_splats()).colors[:, 1:]

    @property
    def colors(self) -> Tensor:
        """Colours [N, 3] without view dependence, about [0, 1]."""
        return SH2RGB(self.shs_0)

    # --- checkpoints -------------------------------------------------------------------------

    def load_state_dict(self, dict: Any, **kwargs: Any) -> Any:
        """nn.Module's: Splatfacto 1.1.5 replaces the parameters that the optimizers hold, and
        Gaussians in new ones would never move again."""
        return nn.Module.load_state_dict(self, dict, **kwargs)

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *args: Any) -> None:
        """torch's hook, called before the children load: take the saved number of Gaussians."""
        for name, parameter in self.gauss_params.items():
            saved = state_dict.get(f"{prefix}gauss_params.{name}")
            if saved is not None and saved.shape[1:] == parameter.shape[1:]:
                parameter.data = parameter.data.new_empty(saved.shape)
                parameter.grad = None
        super()._load_from_state_dict(state_dict, prefix, *args)

    def get_extra_state(self) -> dict[str, Any]:
        """What a checkpoint holds besides parameters: densification's running statistics."""
        return {"static_strategy": dict(self.strategy_state)}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Take up what `get_extra_state` gave."""
        self.strategy_state = state_to_device(state["static_strategy"], self.device)
