"""The colours that static Gaussians have in one image: affine toning (Eq. 6-7), or a change of SH.

Both networks read the image's embedding and features of each Gaussian, and leave every colour as it
is at the start. Letters in shapes: N Gaussians, K bases, E and Z numbers per embedding.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from desplat_ns.backend.inputs import finite_colors
from desplat_ns.backend.projection import cut_at_zero, uncut_colors
from desplat_ns.backend.protocol import Splats, View
from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.cameras.in_view import in_view
from desplat_ns.photo_tourism.config import AppearanceConfig

FREQUENCIES = 4
"""Frequencies of the Fourier features at which each Gaussian's own features z_i start; B.3: 4,
which makes 24 of them, sine and cosine along three axes."""
EMBEDDING_DIM = 32
"""Numbers that describe an image, e_j (B.3). The background reads them, too."""

HIDDEN_LAYERS, HIDDEN_WIDTH = 2, 128
"""Of the MLP, and units in each, as in the background's (B.3)."""

ROWS_AT_ONCE = {"cpu": 2048, "cuda": 65536}
"""Gaussians that pass through the network together: their layers stay in a core's cache, or take a
small part of a GPU's memory."""

CENTRAL_QUANTILE = 0.97
"""Share of the points that set the scale of Fourier features: a few far ones do not count."""

FARTHEST = 1e6
"""Units of that scale. Farther points get the features of this distance, which are arbitrary."""

Lit = Callable[[Tensor], Splats]
"""From an embedding [E] to the Gaussians in its light; colours out of view mean nothing."""


def fourier_features(points: Float[Tensor, "N 3"]) -> Float[Tensor, "N Z"]:
    """Sines and cosines of pi 2^m p for m = 0 .. `FREQUENCIES` - 1, Z = 24; p are the points,
    centred on their mean and divided by the `CENTRAL_QUANTILE` of their largest coordinates.

    Source: the start of z_i, App. B.3; the frequencies are those of the authors' code.
    """
    exact = points.double()  # sums of float32's largest numbers fit, too
    centred = exact - exact.mean(dim=0)
    radius = centred.abs().amax(dim=1).sort().values[int(CENTRAL_QUANTILE * (len(points) - 1))]
    unit = centred / radius.clamp(min=torch.finfo(points.dtype).tiny)
    unit = unit.clamp(-FARTHEST, FARTHEST).to(points.dtype)
    turns = torch.arange(FREQUENCIES, device=points.device, dtype=points.dtype).exp2()
    angles = (math.pi * unit[:, :, None] * turns).flatten(1)
    return torch.cat([angles.sin(), angles.cos()], dim=1)


def toned_color(
    color: Float[Tensor, "N 3"], gamma: Float[Tensor, "N 3"], beta: Float[Tensor, "N 3"]
) -> Float[Tensor, "N 3"]:
    """gamma c + beta, colours in [0, 1]. Source: Eq. 7."""
    return gamma * color + beta


def toned_coefficients(
    coefficients: Float[Tensor, "N K 3"], gamma: Float[Tensor, "N 3"], beta: Float[Tensor, "N 3"]
) -> Float[Tensor, "N K 3"]:
    """SH coefficients whose colour before it is clamped, SH + 1/2, is the toned colour of the given
    ones everywhere: all times gamma, the zeroth shifted by (beta + gamma / 2 - 1/2) / C0.

    Source: Eq. 7.
    """
    zeroth = toned_color(C0 * coefficients[:, 0] + 0.5, gamma, beta) - 0.5
    return torch.cat([(zeroth / C0)[:, None], gamma[:, None] * coefficients[:, 1:]], dim=1)


def as_harmonics(splats: Splats) -> Splats:
    """Colours without spherical harmonics as zeroth coefficients, which say the same."""
    if splats.sh_degree is not None:
        return splats
    return replace(splats, colors=(splats.colors[:, None] - 0.5) / C0, sh_degree=0)


def hidden_layers(inputs: int, layers: int) -> nn.Sequential:
    """`layers` linear layers of `HIDDEN_WIDTH` units, a ReLU after each, where they lie in the
    cache."""
    modules: list[nn.Module] = []
    for width in (inputs, *[HIDDEN_WIDTH] * (layers - 1)):
        modules += [nn.Linear(width, HIDDEN_WIDTH), nn.ReLU(inplace=True)]
    return nn.Sequential(*modules)


def zero_head(outputs: int) -> nn.Linear:
    """A linear layer after them that gives 0 until it is trained."""
    head = nn.Linear(HIDDEN_WIDTH, outputs)
    nn.init.zeros_(head.weight)
    nn.init.zeros_(head.bias)
    return head


class _Appearance(nn.Module):
    """An MLP from an image's embedding and what is known of each Gaussian."""

    def __init__(self, config: AppearanceConfig, per_gaussian: int, outputs: int):
        super().__init__()
        self.scale = config.mlp_scale
        self.body = hidden_layers(EMBEDDING_DIM + per_gaussian, HIDDEN_LAYERS)
        self.head = zero_head(outputs)

    def _predict(
        self,
        embedding: Float[Tensor, " E"],
        own: Sequence[Float[Tensor, "N _"]],
        rows: Int[Tensor, " R"] | None,
    ) -> Float[Tensor, "N outputs"]:
        """The outputs of the given rows, times `mlp_scale`; 0 in all others; of all rows if None.

        The embedding is the same in every row: its part of layer one is worked out once.
        """
        first: Any = self.body[0]
        inputs = torch.cat(list(own), dim=1)
        if rows is not None:
            inputs = inputs.index_select(0, rows)
        of_image, of_gaussian = first.weight.split([len(embedding), inputs.shape[1]], dim=1)
        bias = first.bias + of_image @ embedding
        blocks = [
            self.head(self.body[1:](nn.functional.linear(block, of_gaussian, bias)))
            for block in inputs.split(ROWS_AT_ONCE.get(inputs.device.type, 2048))
        ]
        outputs = self.scale * torch.cat(blocks)
        if rows is None:
            return outputs
        return outputs.new_zeros(len(own[0]), outputs.shape[1]).index_copy(0, rows, outputs)


class AffineAppearance(_Appearance):
    """beta and gamma of each Gaussian in one image, applied to its evaluated colour. Source: Eq.
    6-7; sizes of B.3."""

    def __init__(self, config: AppearanceConfig):
        """Build the MLP; until it is trained, beta = 0 and gamma = 1."""
        super().__init__(config, 6 * FREQUENCIES + 3, 6)

    def tones(
        self,
        embedding: Float[Tensor, " E"],
        features: Float[Tensor, "N Z"],
        zeroth: Float[Tensor, "N 3"],
        rows: Int[Tensor, " R"] | None = None,
    ) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N 3"]]:
        """(beta, gamma) for e_j, z_i and the zeroth SH coefficient, of the given rows; all others
        get (0, 1). Source: Eq. 6."""
        shift, scale = self._predict(embedding, [features, zeroth], rows).split(3, 1)
        return shift, 1 + scale

    def forward(
        self,
        embedding: Float[Tensor, " E"],
        features: Float[Tensor, "N Z"],
        coefficients: Float[Tensor, "N K 3"],
        sh_degree: int,
    ) -> Float[Tensor, "N K 3"]:
        """All coefficients as the image shows them; `sh_degree` plays no part."""
        beta, gamma = self.tones(embedding, features, coefficients[:, 0])
        return toned_coefficients(coefficients, gamma, beta)

    def in_view(self, splats: Splats, features: Float[Tensor, "N Z"], view: View) -> Lit:
        """What `view` shows, by Eq. 7 as it stands: three numbers for each Gaussian are toned, not
        all coefficients. What does not depend on the embedding is worked out once."""
        splats = as_harmonics(splats)
        finite, shown = finite_colors(splats.colors), in_view(splats, view)
        shown = shown if finite is None else shown & finite
        rows = shown.nonzero()[:, 0]
        colors, zeroth = uncut_colors(splats, view, shown)

        def lit(embedding: Tensor) -> Splats:
            beta, gamma = self.tones(embedding, features, zeroth, rows)
            toned = cut_at_zero(toned_color(colors, gamma, beta))
            if finite is not None:  # for the backend to cull them
                toned = toned.masked_fill(~finite[:, None], float("nan"))
            return replace(splats, colors=toned, sh_degree=None)

        return lit


class ShAppearance(_Appearance):
    """What an image adds to each Gaussian's SH coefficients.

    Source: Splatfacto-W, Sec. 3, whose MLP predicts the coefficients themselves; adding to the
    Gaussian's own lets training start at the points' colours.
    """

    def __init__(self, config: AppearanceConfig, sh_degree: int):
        """Build the MLP; until it is trained, it adds 0."""
        self.num_bases = (sh_degree + 1) ** 2
        super().__init__(config, 6 * FREQUENCIES, 3 * self.num_bases)

    def forward(
        self,
        embedding: Float[Tensor, " E"],
        features: Float[Tensor, "N Z"],
        coefficients: Float[Tensor, "N K 3"],
        sh_degree: int,
        rows: Int[Tensor, " R"] | None = None,
    ) -> Float[Tensor, "N K 3"]:
        """The coefficients as the image shows them, up to `sh_degree`; those above stay, and those
        of Gaussians that are not among `rows`, where it is given."""
        added = self._predict(embedding, [features], rows).unflatten(1, (self.num_bases, 3))
        used = (sh_degree + 1) ** 2
        return torch.cat([coefficients[:, :used] + added[:, :used], coefficients[:, used:]], dim=1)

    def in_view(self, splats: Splats, features: Float[Tensor, "N Z"], view: View) -> Lit:
        """What `view` shows."""
        splats = as_harmonics(splats)
        rows, degree = in_view(splats, view).nonzero()[:, 0], splats.sh_degree
        assert degree is not None
        return lambda embedding: replace(
            splats, colors=self(embedding, features, splats.colors, degree, rows)
        )
