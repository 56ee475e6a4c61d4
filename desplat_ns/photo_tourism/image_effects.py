"""The per-image effects that are on, together: embeddings, appearance, background."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor, nn

from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.effects import EffectsConfig
from desplat_ns.photo_tourism.appearance import AffineAppearance, ShAppearance
from desplat_ns.photo_tourism.background import Background, background_color, pixel_basis
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig, check_sizes
from desplat_ns.photo_tourism.embeddings import ImageEmbeddings
from desplat_ns.photo_tourism.lit_splats import Lit, as_harmonics, lit_splats

FEATURES = "appearance_features"
"""Name of z_i among the static Gaussians' parameters, where every split, clone and prune finds
them."""


class ImageEffects(nn.Module):
    """What an image's embedding changes: the static colours, the background, or both."""

    def __init__(
        self,
        effects: EffectsConfig,
        appearance: AppearanceConfig,
        background: BackgroundConfig,
        num_images: int,
        sh_degree: int,
    ):
        """Build what `effects` asks for; without appearance all images share one embedding.

        Args:
            num_images: training images.
            sh_degree: of the static Gaussians.

        Raises:
            ConfigError: sizes that no model can have.
        """
        check_sizes(appearance, "--pipeline.model.appearance")
        check_sizes(background, "--pipeline.model.background")
        super().__init__()
        per_image = num_images if effects.appearance != "off" else 1
        self.embeddings = ImageEmbeddings(per_image, appearance.embedding_dim)
        self.appearance: AffineAppearance | ShAppearance | None = None
        if effects.appearance == "affine":
            self.appearance = AffineAppearance(appearance)
        elif effects.appearance == "sh":
            self.appearance = ShAppearance(appearance, sh_degree)
        self.background = (
            Background(background, appearance.embedding_dim) if effects.background else None
        )
        self.background_degree = background.sh_degree
        self._last: tuple[View, int, Tensor] | None = None

    def toned(
        self, splats: Splats, features: Float[Tensor, "N Z"], embedding: Float[Tensor, " E"]
    ) -> Splats:
        """All static Gaussians in the colours of the image that `embedding` describes.

        Args:
            features: z_i.
        """
        if self.appearance is None:
            return splats
        splats = as_harmonics(splats)
        assert splats.sh_degree is not None
        colors = self.appearance(embedding, features, splats.colors, splats.sh_degree)
        return replace(splats, colors=colors)

    def lit(
        self,
        splats: Splats,
        features: Float[Tensor, "N Z"],
        view: View,
        settings: RenderSettings,
        frozen: bool = False,
    ) -> Lit:
        """Static Gaussians as a view shows them, given an embedding [E]; quicker than `toned`.

        Args:
            features: z_i.
            frozen: whether nothing but the embedding is to get a gradient.
        """
        assert self.appearance is not None
        appearance = deepcopy(self.appearance).requires_grad_(False) if frozen else self.appearance
        return lit_splats(appearance, splats, features, view, settings)

    def background_of(
        self, embedding: Float[Tensor, " E"], view: View, degree: int
    ) -> Float[Tensor, "H W 3"]:
        """The background of the image that `embedding` describes, seen from `view`.

        Call it where there is one only. `degree` is cut to that of the background.
        """
        assert self.background is not None
        basis = self._basis(view, min(degree, self.background_degree))
        return background_color(self.background(embedding), basis)

    def _basis(self, view: View, degree: int) -> Tensor:
        """The harmonics of a view; outside of training the last one's are kept, since an embedding
        is optimized on one view."""
        if self.training:
            self._last = None
            return pixel_basis(view, degree)
        if self._last is None or self._last[0] is not view or self._last[1] != degree:
            self._last = (view, degree, pixel_basis(view, degree))
        return self._last[2]

    def param_groups(self) -> dict[str, list[nn.Parameter]]:
        """An optimizer group for each learning rate of B.3; none for what is off."""
        groups = {"image_embeddings": list(self.embeddings.parameters())}
        if self.appearance is not None:
            groups["appearance_mlp"] = list(self.appearance.parameters())
        if self.background is not None:
            groups["background_encoder"] = list(self.background.encoder.parameters())
            groups["background_sh_dc"] = list(self.background.sh_dc.parameters())
            groups["background_sh_rest"] = list(self.background.sh_rest.parameters())
        return groups


def wants_image_effects(effects: EffectsConfig) -> bool:
    """Whether any of the effects needs embeddings."""
    return effects.appearance != "off" or effects.background
