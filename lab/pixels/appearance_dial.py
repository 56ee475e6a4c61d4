"""The appearance network in float32 and in bfloat16: another piece of work than rasterizing.

The truth is the same network in float64. It is one as it is after training: heads that spread gamma
by 0.2 and beta by 0.1 or so, over the Gaussians of a scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import torch
from jaxtyping import Float
from torch import Tensor, nn

from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.calibration.scenes import Scene
from desplat_ns.photo_tourism.appearance import AffineAppearance, fourier_features, toned_color
from desplat_ns.photo_tourism.config import AppearanceConfig, MlpDtype, has_bfloat16
from lab.pixels.dial_errors import Drawn
from lab.pixels.rasterizing import Cases

MLP_DTYPES: tuple[MlpDtype, ...] = get_args(MlpDtype)


def trained_network() -> AffineAppearance:
    """B.3's sizes, weights of torch's own start, and a head that has moved."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = AffineAppearance(AppearanceConfig())
        nn.init.normal_(network.head.weight, std=0.06)
    return network


def bfloat16_unavailable_reason() -> str | None:
    """Why this processor does not train in bfloat16; None where it does."""
    return None if has_bfloat16("cpu") else "This processor has no instructions for bfloat16."


@dataclass(frozen=True)
class Toning:
    """All Gaussians' colours in the light of one image."""

    network: AffineAppearance
    features: Float[Tensor, "N Z"]
    embedding: Float[Tensor, " E"]
    zeroth: Float[Tensor, "N 3"]
    """SH coefficients."""
    weight: Float[Tensor, "N 3"]
    """The gradient of toned colours."""

    def colors(self) -> Float[Tensor, "N 3"]:
        """Toned, Eq. 6-7."""
        beta, gamma = self.network.tones(self.embedding, self.features, self.zeroth)
        return toned_color(C0 * self.zeroth + 0.5, gamma, beta)

    def leaves(self) -> dict[str, Tensor]:
        """What gets gradients, the network's weights by their names."""
        own = {"features": self.features, "embedding": self.embedding, "zeroth": self.zeroth}
        return {**own, **dict(self.network.named_parameters())}

    def timed(self) -> Cases:
        """Forward, and forward + backward."""
        return torch.no_grad()(self.colors), self._pulled

    def _pulled(self) -> tuple[Tensor, ...]:
        leaves = tuple(self.leaves().values())
        return torch.autograd.grad(self.colors(), leaves, self.weight)

    def drawn(self) -> Drawn:
        """Toned colours and their gradients."""
        gradients = dict(zip(self.leaves(), (g.double() for g in self._pulled()), strict=True))
        return Drawn(self.colors().detach().double(), gradients)


def toning(scene: Scene, products: MlpDtype | None) -> Toning:
    """The scene's Gaussians toned in float32 with products of a dtype; all in float64 if None."""
    dtype = torch.float64 if products is None else torch.float32
    rng = torch.Generator().manual_seed(1)
    network = trained_network().to(dtype)
    network.in_bfloat16 = products == "bfloat16"
    zeroth = scene.params["features_dc"]
    frequencies = AppearanceConfig().fourier_frequencies
    embedding = 0.5 * torch.randn(AppearanceConfig().embedding_dim, generator=rng)
    return Toning(
        network,
        fourier_features(scene.params["means"], frequencies).to(dtype).requires_grad_(),
        embedding.to(dtype).requires_grad_(),
        zeroth.to(dtype, copy=True).requires_grad_(),
        torch.randn(zeroth.shape, generator=rng).to(dtype),
    )
