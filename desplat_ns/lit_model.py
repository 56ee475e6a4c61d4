"""The static Gaussians drawn: by any backend, in the light of any image, before its background."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.models.splatfacto import SH2RGB, SplatfactoModel, SplatfactoModelConfig
from torch import Tensor, nn

from desplat_ns.backend import BackendName, Rasterizer, resolve
from desplat_ns.backend.accumulated_weights import accumulated_weights
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from desplat_ns.errors import BackendUnavailableError
from desplat_ns.gaussians.activation import RawParameters, activate_static
from desplat_ns.photo_tourism.appearance import fourier_features
from desplat_ns.photo_tourism.background import BACKGROUND_DEGREE_INTERVAL
from desplat_ns.photo_tourism.camera_response import fit_response, squared_radius
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.photo_tourism.image_effects import FEATURES, ImageEffects, wants_image_effects
from desplat_ns.photo_tourism.shown_light import ShownLight
from desplat_ns.rendering.compositing import over_background
from desplat_ns.rendering.views import view_of
from desplat_ns.settings.effects import Effects, EffectsConfig
from desplat_ns.training.budget import Clock


@dataclass
class LitModelConfig(SplatfactoModelConfig):
    """Splatfacto's settings, with those of the backend and of the per-image effects."""

    _target: type = field(default_factory=lambda: LitModel)
    effects: EffectsConfig = field(default_factory=EffectsConfig)
    """Which effects the scene calls for."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """Per-image appearance, where `effects.appearance` has it."""
    background: BackgroundConfig = field(default_factory=BackgroundConfig)
    """Background model, where `effects.background` has it."""
    backend: BackendName = "auto"
    """Rasterizer. auto takes gsplat on CUDA, and numba on the CPU."""


class LitModel(SplatfactoModel):
    """Splatfacto with a backend of choice, and with the per-image effects that are on."""

    config: LitModelConfig
    effects: Effects
    """Those of this model, all decided."""
    image_effects: ImageEffects | None
    clock = Clock()
    """Of the run: all schedules are in its nominal steps."""

    def __init__(self, config: LitModelConfig, *args: Any, **kwargs: Any):
        self._rasterizer: Rasterizer | None = None
        super().__init__(config, *args, **kwargs)

    def add_image_effects(self) -> None:
        """Build what `effects` asks for, once the static Gaussians are there."""
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

    @property
    def nominal_step(self) -> int:
        """Where schedules are in the step at hand."""
        return self.clock.nominal(self.step)

    def _sh_degree(self) -> int | None:
        if self.config.sh_degree == 0:
            return None
        return min(self.nominal_step // self.config.sh_degree_interval, self.config.sh_degree)

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
            degree = self.nominal_step // BACKGROUND_DEGREE_INTERVAL
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
        return self.apply_camera_response(image, view, embedding)

    def apply_camera_response(self, colors: Tensor, view: View, embedding: Tensor | None) -> Tensor:
        """Colours of the scene, one [3] or an image [H, W, 3], as the image's camera shows them."""
        if self.image_effects is None or embedding is None:
            return colors
        return self.image_effects.apply_camera_response(colors, view, embedding)

    def params_in(self, view: View) -> RawParameters:
        """The static Gaussians that a view may show, raw."""
        return self.gauss_params

    def as_function_of_embedding(
        self, view: View, columns: int | None = None
    ) -> Callable[[Tensor], Tensor]:
        """The static scene [H, W, 3] seen from `view`, given an image embedding [E].

        Everything else is held constant. Where `columns` is given, only as many of the first ones
        are right: what they do not show is left out. Where such a Gaussian ended the blending of a
        pixel unseen, what is behind then shows, by TRANSMITTANCE_MIN / (1 - ALPHA_MAX) at most.
        """
        constants = {name: value.detach() for name, value in self.params_in(view).items()}
        settings, splats = self.render_settings(depth=False), self._splats(constants, None)
        if columns is not None:
            weights = accumulated_weights(self.rasterizer, splats, view, settings, columns)
            constants = {name: value[weights > 0] for name, value in constants.items()}
            splats = self._splats(constants, None)
        lit = self._lit(splats, constants, view, frozen=True)
        static = self.rasterizer(splats, view, settings) if lit is None else None

        def draw(embedding: Tensor) -> Tensor:
            drawn = static
            if lit is not None:
                drawn = self.rasterizer(lit(embedding), view, settings)
            assert drawn is not None
            background = self.background_of(view, embedding)
            return self.image_of(drawn, background, view, embedding).clamp(0, 1)

        return draw

    @torch.no_grad()
    def embedding_in_closed_form(self, view: View, photo: Tensor, counts: Tensor) -> Tensor:
        """The numbers of the camera's response [5] that explain a photo [H, W, 3] best in the
        pixels that `counts` [H, W] names. Call it only if `effects.closed_form`."""
        splats = self._splats(self.params_in(view), None)
        static = self.rasterizer(splats, view, self.render_settings(depth=False))
        background = self.background_of(view, self.average_embedding())
        image = self.image_of(static, background, view, None)
        return fit_response(image[counts], photo[counts], squared_radius(view)[counts])

    def _lit(
        self,
        splats: Splats,
        params: RawParameters,
        view: View,
        frozen: bool = False,
    ) -> Callable[[Tensor], Splats] | None:
        """Gives the static Gaussians in the colours of an embedding, as far as `view` shows them;
        None if they have the same in all."""
        if self.image_effects is None or FEATURES not in params:
            return None
        return self.image_effects.appearance_in_view(splats, params[FEATURES], view, frozen)

    def _splats(self, params: RawParameters, embedding: Tensor | None) -> Splats:
        """Static Gaussians in the colours of the image that `embedding` describes."""
        splats = activate_static(params, self._sh_degree())
        if self.image_effects is None or embedding is None or FEATURES not in params:
            return splats
        return self.image_effects.apply_appearance(splats, params[FEATURES], embedding)

    @torch.no_grad()
    def shown_splats(self, rows: Tensor | None = None) -> Splats:
        """The static Gaussians in the light that is shown: what a file can hold of them; those of
        the given rows only, by number or mask, where there are some."""
        params: RawParameters = self.gauss_params
        if rows is not None:
            params = {name: value[rows] for name, value in params.items()}
        return self._splats(params, self.embedding_of(None))

    def baked_coefficients(self) -> Tensor:
        """SH coefficients [N, K, 3] in the light that is shown."""
        return self.shown_splats().colors

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
