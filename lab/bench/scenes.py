"""Generated Gaussians that cost what a trained capture costs.

What a rasterizer has to do depends on how large, how opaque and how elongated the Gaussians are, so
these three are drawn like those of a capture that has been trained for a while:

- A fifth of the Gaussians lies outside the picture, as most of a capture does for any one photo.
- Sizes are log-normal. The typical size follows from the picture: a trained scene covers every
  pixel with some tens of visible Gaussians, so a Gaussian's area is the picture's divided by their
  number. The spread leaves small ones (texture) that fill less than a pixel, and large ones (walls,
  sky) that cover many tiles.
- The three axes differ: a log-normal factor each, and one axis is flat, for they lie on surfaces.
- Opacities are of two kinds, as training leaves them: two thirds are faint, the others nearly
  opaque.

At 20,000 Gaussians and 480 x 270 pixels this gives, in (pixel, Gaussian) pairs: 27 million in
3-sigma square lists, 17 million in exact lists, 7.4 million looked at, 5.5 million that contribute.
A trained capture of this size that was counted had 27, 18, 11 (by coarser rows) and 5.5.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from desplat_ns.backend.protocol import Splats, View
from desplat_ns.gaussians.activation import activate_static

SH_DEGREE = 3
FOCAL = 0.9
"""Focal length over the picture's width: 58 degrees across."""

MARGIN = 1.118
"""Gaussians lie in this multiple of the field of view, each way: 1 / 1.118^2 = 80% inside."""

DEPTHS = (2.0, 12.0)
"""World units, log-uniform: nearer surfaces are seen in more detail."""

COVER = 0.82
"""Typical standard deviation in pixels over sqrt(pixels / Gaussians)."""

SIZE_SPREAD = 0.8
"""Of log(size), over Gaussians."""

AXIS_SPREAD = 0.25
"""Of the logarithm of each axis over the size."""

FLATNESS = 0.5
"""The third axis over the others."""

FAINT_SHARE = 0.65
FAINT, OPAQUE = (-1.1, 1.0), (2.0, 1.5)
"""Mean and deviation of the logits of opacity: around 0.25, and around 0.88."""

GENERATOR_SEED = 20261120


@dataclass(frozen=True)
class Scene:
    """Raw parameters under Splatfacto's names, and the view that they are seen from."""

    name: str
    params: dict[str, Tensor]
    view: View

    def splats(self, dtype: torch.dtype = torch.float32, device: str = "cpu") -> Splats:
        """Activated Gaussians, float32 numbers in any dtype: leaves that require gradients."""
        splats = activate_static(self.params, SH_DEGREE)
        return Splats(
            *(t.to(device, dtype).requires_grad_() for t in tensors_of(splats)), sh_degree=SH_DEGREE
        )


PARAMETERS = ("means", "quats", "scales", "opacities", "colors")


def tensors_of(splats: Splats) -> list[Tensor]:
    """means, quats, scales, opacities, colors."""
    return [getattr(splats, name) for name in PARAMETERS]


def make_scene(count: int, width: int, height: int) -> Scene:
    """`count` Gaussians before a camera of `width` x `height` pixels; the same for the same
    call."""
    rng = torch.Generator().manual_seed(GENERATOR_SEED)
    pixels = COVER * math.sqrt(width * height / count)
    x, y, depth = _places(count, height / width, rng)
    size = torch.exp(SIZE_SPREAD * torch.randn(count, generator=rng)) * pixels
    axes = torch.exp(AXIS_SPREAD * torch.randn(count, 3, generator=rng))
    axes[:, 2] *= FLATNESS
    scales = (size * depth / (FOCAL * width))[:, None] * axes
    viewmat = _camera()
    in_camera = torch.stack([x * depth, y * depth, depth], dim=-1)
    params = {
        "means": (in_camera - viewmat[:3, 3]) @ viewmat[:3, :3],
        "quats": torch.randn(count, 4, generator=rng),
        "scales": scales.log(),
        "opacities": _logits(count, rng)[:, None],
        **_colors(count, rng),
    }
    K = torch.tensor([[FOCAL * width, 0, width / 2], [0, FOCAL * width, height / 2], [0, 0, 1]])
    name = f"{count / 1000:g}k @ {width} x {height}"
    return Scene(name, params, View(viewmat, K, width, height))


def _camera() -> Tensor:
    """World to camera, turned and moved off the axes."""
    axis = torch.tensor([0.3, -0.8, 0.2])
    cross = torch.linalg.cross(torch.eye(3), axis[None].expand(3, 3))
    viewmat = torch.eye(4)
    viewmat[:3, :3] = torch.linalg.matrix_exp(cross)
    viewmat[:3, 3] = torch.tensor([0.4, -0.3, 0.6])
    return viewmat


def _places(count: int, aspect: float, rng: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Slopes x / z and y / z, and depths z in world units."""
    x, y, t = torch.rand(3, count, generator=rng)
    half = MARGIN / (2 * FOCAL)
    near, far = DEPTHS
    return half * (2 * x - 1), aspect * half * (2 * y - 1), near * (far / near) ** t


def _logits(count: int, rng: torch.Generator) -> Tensor:
    faint = torch.rand(count, generator=rng) < FAINT_SHARE
    spread = torch.randn(count, generator=rng)
    return torch.where(faint, FAINT[0] + FAINT[1] * spread, OPAQUE[0] + OPAQUE[1] * spread)


def _colors(count: int, rng: torch.Generator) -> dict[str, Tensor]:
    """Spherical harmonics; each band is half as strong as the one below it."""
    bands = [0.1 * 0.5**band for band in (0, 1, 2) for _ in range(2 * band + 3)]
    rest = torch.randn(count, len(bands), 3, generator=rng) * torch.tensor(bands)[:, None]
    return {
        "features_dc": 0.8 * torch.randn(count, 3, generator=rng),
        "features_rest": rest,
    }
