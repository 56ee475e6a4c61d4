"""What lies behind all Gaussians: one colour, or spherical harmonics that all images share or that
depend on the image (Eq. 8-11)."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from desplat_ns.backend.protocol import View
from desplat_ns.backend.spherical_harmonics import sh_basis
from desplat_ns.photo_tourism.appearance import EMBEDDING_DIM, hidden_layers, zero_head

BACKGROUND_DEGREE = 4
"""Of its spherical harmonics (B.3)."""

HIDDEN_LAYERS = 3
"""Of the MLP (B.3)."""

BACKGROUND_DEGREE_INTERVAL = 500
"""Nominal steps after which one degree more of its harmonics is learned; as in the authors' code.
"""

NODES = 96
"""Rays along each side of a picture along which the harmonics are evaluated; in between, colours
are interpolated. A harmonic of degree l then errs by a^2 l (l + 1) / 8 of its size along each side,
a being the angle from ray to ray: at degree 4 and 90 degrees of view by 0.001 at most."""


def rays(
    view: View, x: Float[Tensor, " columns"], y: Float[Tensor, " rows"]
) -> Float[Tensor, "rows columns 3"]:
    """Unit directions in the world from the camera through places of the picture, in pixels."""
    column = (x - view.K[0, 2]) / view.K[0, 0]
    row = (y - view.K[1, 2]) / view.K[1, 1]
    v, u = torch.meshgrid(row, column, indexing="ij")
    in_camera = torch.stack([u, v, torch.ones_like(u)], dim=-1)
    return F.normalize(in_camera @ view.viewmat[:3, :3], dim=-1)


def _nodes(size: int, like: Tensor) -> tuple[Float[Tensor, " nodes"], Float[Tensor, "size nodes"]]:
    """Places along one side of a picture, in pixels, and how much each pixel takes of each."""
    count = min(size, NODES)
    spacing = (size - 1) / max(count - 1, 1)
    nodes = torch.arange(count, device=like.device, dtype=like.dtype) * spacing
    pixels = torch.arange(size, device=like.device, dtype=like.dtype)
    distance = (pixels[:, None] - nodes).abs() / max(spacing, 1.0)
    return nodes + 0.5, (1 - distance).clamp(min=0)


def background_image(
    coefficients: Float[Tensor, "K 3"], view: View, degree: int
) -> Float[Tensor, "H W 3"]:
    """SH + 1/2, up to a degree of (degree + 1)^2 <= K, along the ray through each pixel's centre,
    clamped to [0, 1].

    Source: App. A, c_BG of Eq. 8; the 1/2 is that of the Gaussians' colours. See `NODES`.
    """
    x, across = _nodes(view.width, view.viewmat)
    y, down = _nodes(view.height, view.viewmat)
    basis = sh_basis(degree, rays(view, x, y).reshape(-1, 3))
    colors = (basis @ coefficients[: basis.shape[1]]).unflatten(0, (len(y), len(x)))
    by_row = down @ colors.permute(0, 2, 1).reshape(len(y), -1)  # H x (3 columns)
    by_pixel = by_row.reshape(-1, len(x)) @ across.T
    return (by_pixel.unflatten(0, (view.height, 3)).permute(0, 2, 1) + 0.5).clamp(0, 1)


class SharedBackground(nn.Module):
    """The SH coefficients of a background that all images share; of degree 0, one colour."""

    def __init__(self, degree: int):
        """Grey everywhere, until it is trained."""
        super().__init__()
        self.degree = degree
        self.coefficients = nn.Parameter(torch.zeros((degree + 1) ** 2, 3))

    def forward(self, embedding: Float[Tensor, " E"]) -> Float[Tensor, "K 3"]:
        """The same for every image."""
        return self.coefficients


class Background(nn.Module):
    """The SH coefficients of an image's own background. Source: Eq. 8; sizes of B.3."""

    def __init__(self):
        """Build the MLP; until it is trained, the background is grey."""
        super().__init__()
        self.degree = BACKGROUND_DEGREE
        self.encoder = hidden_layers(EMBEDDING_DIM, HIDDEN_LAYERS)
        self.sh_dc = zero_head(3)
        self.sh_rest = zero_head(3 * ((self.degree + 1) ** 2 - 1))

    def forward(self, embedding: Float[Tensor, " E"]) -> Float[Tensor, "K 3"]:
        """b = f_BG(e_j), of degree 0 and of the other degrees by a head each."""
        hidden = self.encoder(embedding)
        return torch.cat([self.sh_dc(hidden), self.sh_rest(hidden)]).view(-1, 3)
