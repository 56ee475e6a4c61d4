"""The `gsplat` backend: gsplat's CUDA kernels. The only module that imports gsplat's rasterizer.

Departs from the exact backends in one thing: gsplat cuts every Gaussian off at the square of 3
sigma, where an opaque one still has an alpha of 0.011. `gsplat_build` has its kernels compiled.
"""

from dataclasses import replace

import torch
from jaxtyping import Bool
from torch import Tensor

from desplat_ns.backend.constants import EPS2D, FAR_PLANE, NEAR_PLANE
from desplat_ns.backend.inputs import MIN_QUAT_NORM, check_inputs
from desplat_ns.backend.projection import cut_at_zero, uncut_colors
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View


class GsplatRasterizer:
    """gsplat 1.4.0, float32 on CUDA."""

    name = "gsplat"

    def __call__(self, splats: Splats, view: View, settings: RenderSettings) -> Rendering:
        """Rasterize `splats` seen from `view`. Raises ValueError: shapes do not fit."""
        from gsplat.rendering import rasterization

        check_inputs(splats, view)
        if len(splats.means) == 0:
            return _empty(splats, view, settings)
        means, colors = _with_unsound_behind(splats, view)
        image, alpha, info = rasterization(
            means=means,
            quats=splats.quats,
            scales=splats.scales,
            opacities=splats.opacities,
            colors=colors,
            viewmats=view.viewmat[None],
            Ks=view.K[None],
            width=view.width,
            height=view.height,
            near_plane=NEAR_PLANE,
            far_plane=FAR_PLANE,
            eps2d=EPS2D,
            packed=False,
            render_mode="RGB+ED" if settings.depth else "RGB",
            absgrad=settings.absgrad,
            rasterize_mode="antialiased" if settings.antialiased else "classic",
        )
        return Rendering(
            rgb=image[0, ..., :-1] if settings.depth else image[0],
            alpha=alpha[0],
            depth=image[0, ..., -1:] if settings.depth else None,
            means2d=info["means2d"],
            radii=info["radii"][0],
        )


def _with_unsound_behind(splats: Splats, view: View) -> tuple[Tensor, Tensor]:
    """Means, those that gsplat would turn into NaN moved behind the camera, and colours seen from
    `view`: gsplat's own cut at 0 has no gradient."""
    rotation, translation = view.viewmat[:3, :3].detach(), view.viewmat[:3, 3].detach()
    # Of (0, 0, -1), before the camera's axes.
    behind = torch.addmv(rotation[2], rotation.T, translation, beta=-1, alpha=-1)
    sound = _is_sound(splats)
    means = torch.where(sound[:, None], splats.means, behind)
    if splats.sh_degree is None:
        return means, splats.colors
    colors, _ = uncut_colors(replace(splats, means=means), view, sound)
    return means, cut_at_zero(colors)


@torch.no_grad()
def _is_sound(splats: Splats) -> Bool[Tensor, " N"]:
    """As `is_finite`, and the determinant of a covariance, of the order of a scale's fourth power,
    does not overflow. By norms of all numbers at once: on a GPU each operation is a launch."""
    scales2, opacities = splats.scales.square(), splats.opacities[:, None]
    numbers = torch.cat([splats.means, splats.quats, scales2, opacities], dim=-1)
    norm = torch.linalg.vector_norm
    size = norm(numbers, dim=-1) + norm(splats.colors.flatten(1), dim=-1)
    # comparisons with NaN are False
    return (size < torch.inf) & (norm(splats.quats, dim=-1) > MIN_QUAT_NORM)


def _empty(splats: Splats, view: View, settings: RenderSettings) -> Rendering:
    """What is drawn of no Gaussians: nothing, but differentiable like any other rendering."""
    nothing = splats.means.sum() + splats.colors.sum()
    image = nothing.expand(view.height, view.width, 3)
    alpha = nothing.expand(view.height, view.width, 1)
    return Rendering(
        rgb=image,
        alpha=alpha,
        depth=alpha if settings.depth else None,
        means2d=splats.means[None, :, :2],
        radii=torch.zeros(0, dtype=torch.int32, device=splats.means.device),
    )
