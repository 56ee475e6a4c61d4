"""The `numba` backend: Gaussian splatting on a CPU, fast enough to train with.

    project         projection.py             the formulas of backend/projection.py, compiled
    colour          sh.py                     spherical harmonics and their gradients
    bin             binning.py, ellipses.py   exact ellipse/tile lists, front to back
    draw, backward  passes.py, pixels.py      tile kernels with an analytic backward pass

All of them are in `numba_kernels`. Everything is float32, sums over tiles excepted (float64), and
gives the same bits for any number of threads (`numba.set_num_threads`, or the environment variable
NUMBA_NUM_THREADS).
"""

from __future__ import annotations

import gc
from dataclasses import replace
from typing import TypeVar

import numpy as np
import torch

from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.inputs import check_inputs, finite_colors
from desplat_ns.backend.numba_kernels import runtime
from desplat_ns.backend.numba_kernels.binning import Gaussians, Grid, tile_lists
from desplat_ns.backend.numba_kernels.ellipses import FEATURES, TILE
from desplat_ns.backend.numba_kernels.passes import Frame, backward_frame, draw_frame, sum_rows
from desplat_ns.backend.numba_kernels.pixels import AREA, GEOMETRY, Limits
from desplat_ns.backend.numba_kernels.projection import Project, make_camera
from desplat_ns.backend.numba_kernels.runtime import (
    empty,
    flat,
    launching,
    new_counter,
    num_workers,
)
from desplat_ns.backend.numba_kernels.sh import EvaluateColors
from desplat_ns.backend.projection import ProjectedSplats, project
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from desplat_ns.errors import BackendUnavailableError

Input = TypeVar("Input", Splats, View)

_LIMITS = Limits(np.float32(ALPHA_MAX), np.float32(ALPHA_CUTOFF), np.float32(TRANSMITTANCE_MIN))


class NumbaRasterizer:
    """Rasterizes on the CPU with compiled tile kernels. See `protocol.Rasterizer`.

    Computes in float32 whatever the dtype of the splats, and returns float32.
    """

    name = "numba"

    def __call__(self, splats: Splats, view: View, settings: RenderSettings) -> Rendering:
        """Rasterize `splats` seen from `view`. Differentiable in every tensor of `splats`.

        Raises:
            BackendUnavailableError: the splats are not on the CPU.
            ValueError: shapes do not fit together, or the camera cannot be.
        """
        if splats.means.device.type != "cpu":
            raise BackendUnavailableError(
                f"Backend 'numba' renders on the CPU and the Gaussians are on "
                f"{splats.means.device}. Add `--machine.device-type cpu`, or choose "
                "`--pipeline.model.backend gsplat`."
            )
        projected = _project(_in_float32(splats), _in_float32(view), settings)
        grid = Grid(view.width, view.height, -(-view.width // TILE), -(-view.height // TILE))
        rgb, alpha, depth = _Rasterize.apply(
            projected.means2d,
            projected.conics,
            projected.depths,
            projected.opacities,
            projected.colors,
            projected.radii,
            grid,
            settings,
        )  # type: ignore[misc]  # torch does not annotate Function.apply
        return Rendering(
            rgb=rgb,
            alpha=alpha,
            depth=depth / alpha.clamp(min=1e-10) if settings.depth else None,
            means2d=projected.means2d,
            radii=projected.radii,
        )


def _project(splats: Splats, view: View, settings: RenderSettings) -> ProjectedSplats:
    """`projection.project`, compiled where the camera needs no gradient."""
    check_inputs(splats, view)
    if view.viewmat.requires_grad or view.K.requires_grad:
        return project(splats, view, settings)
    colors, camera = splats.colors, make_camera(view, settings.antialiased)
    means2d, conics, depths, opacities, radii = Project.apply(
        splats.means, splats.quats, splats.scales, splats.opacities, camera, finite_colors(colors)
    )  # type: ignore[misc]  # torch does not annotate Function.apply
    if splats.sh_degree is not None:
        colors = EvaluateColors.apply(splats.means, colors, radii, view.center, splats.sh_degree)
    return ProjectedSplats(means2d, conics, depths, opacities, colors, radii)  # type: ignore[arg-type]


def _in_float32(of: Input) -> Input:
    """Splats or a view, each of its tensors in float32."""
    tensors = {name: v.float() for name, v in vars(of).items() if isinstance(v, torch.Tensor)}
    return replace(of, **tensors)


class _Rasterize(torch.autograd.Function):
    """(means2d, conics, depths, opacities, colors) -> colours, alpha, sum of w z (or empty)."""

    @staticmethod
    def forward(ctx, means2d, conics, depths, opacities, colors, radii, grid, settings):  # type: ignore[override]
        channels = colors.shape[1]
        inputs = map(flat, (means2d, conics, depths, opacities, colors))
        gaussians = Gaussians(*inputs, channels=channels)
        rgb = empty(grid.height, grid.width, channels)
        alpha = empty(grid.height, grid.width, 1)
        depth = empty(grid.height, grid.width, 1) if settings.depth else empty(0)
        area = grid.tiles_x * grid.tiles_y * AREA
        state = (np.empty(area, np.float32), np.empty(area, np.float32))
        frame = Frame(flat(rgb), flat(depth), flat(alpha), *state)
        with launching():
            lists, stride = tile_lists(gaussians, flat(radii), grid, settings.depth, ALPHA_CUTOFF)
            draw_frame(lists, stride, grid, frame, channels, _LIMITS, new_counter(), num_workers())
        ctx.save_for_backward(rgb, depth, alpha)
        ctx.state = (lists, stride, state, channels, grid, settings)
        ctx.means2d = means2d
        return rgb, alpha, depth

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad_rgb, grad_alpha, grad_depth):  # type: ignore[override]
        lists, stride, state, channels, grid, settings = ctx.state
        frame = Frame(*map(flat, ctx.saved_tensors), *state)
        pulled = Frame(flat(grad_rgb), flat(grad_depth), flat(grad_alpha), *state)
        width = GEOMETRY + stride - FEATURES
        sums = torch.zeros(ctx.means2d.shape[1], width, dtype=torch.float32)  # of those not drawn 0
        grads, frames = np.empty(lists.ranks.size * width, np.float32), (frame, pulled)
        with launching():
            rest = channels, _LIMITS, grads, new_counter(), num_workers()
            backward_frame(lists, stride, grid, *frames, *rest)
            sum_rows(lists, grads, width, flat(sums), new_counter(), num_workers())
        if settings.absgrad:
            ctx.means2d.absgrad = sums[None, :, 2:4]
        depth = sums[:, GEOMETRY + channels] if settings.depth else None
        colors = sums[:, GEOMETRY : GEOMETRY + channels]
        return sums[None, :, :2], sums[:, 4:7], depth, sums[:, 7], colors, None, None, None


def compile_all() -> None:
    """Launch every kernel in a process that compiles them; `runtime` starts one where it must.

    What a kernel becomes may depend on what the process has compiled before (a product of three
    numbers is taken in another order), so they are always compiled in the order of this step.
    """
    from desplat_ns.backend.ssim import ssim

    runtime.compiles_here = True
    gc.disable()  # a tenth faster, for a process that ends soon
    shapes = ((1, 3), (1, 4), (1, 3), (1,), (1, 4, 3))
    means, *others = (torch.ones(shape, requires_grad=True) for shape in shapes)
    photo, matrix = torch.zeros(16, 16, 3), torch.diag(torch.tensor([16.0, 16.0, 1.0]))
    drawn = NumbaRasterizer()(
        Splats(means, *others, sh_degree=1),
        View(torch.eye(4), matrix, 16, 16),
        RenderSettings(antialiased=True, depth=True, absgrad=True),
    )
    (drawn.alpha + ssim(drawn.rgb, photo)).sum().backward()
