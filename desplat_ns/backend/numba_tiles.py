"""The `numba` backend: Gaussian splatting on a CPU, fast enough to train with.

    project         projection.py             the formulas of backend/projection.py, compiled
    colour          sh.py                     spherical harmonics and their gradients
    bin             binning.py, ellipses.py   exact ellipse/tile lists, front to back
    draw, backward  passes.py, pixels.py      tile kernels with an analytic backward pass

All of them are in `numba_kernels`. Everything is float32, sums over tiles excepted (float64), and
gives the same bits for any number of threads (`numba.set_num_threads`, or the environment variable
NUMBA_NUM_THREADS).
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np
import torch

from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.inputs import check_inputs, finite_colors
from desplat_ns.backend.numba_kernels import runtime
from desplat_ns.backend.numba_kernels.binning import Grid, tile_lists
from desplat_ns.backend.numba_kernels.ellipses import TILE
from desplat_ns.backend.numba_kernels.passes import Frame, backward_frame, draw_frame, sum_rows
from desplat_ns.backend.numba_kernels.pixels import AREA, WIDTH, Limits
from desplat_ns.backend.numba_kernels.projection import Project, make_camera
from desplat_ns.backend.numba_kernels.runtime import empty, flat, launch
from desplat_ns.backend.numba_kernels.sh import EvaluateColors
from desplat_ns.backend.projection import ProjectedSplats, project
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View

Input = TypeVar("Input", Splats, View)

_LIMITS = Limits(np.float32(ALPHA_MAX), np.float32(ALPHA_CUTOFF), np.float32(TRANSMITTANCE_MIN))


class NumbaRasterizer:
    """Rasterizes on the CPU with compiled tile kernels, in float32 whatever the dtype of the
    splats. See `protocol.Rasterizer`."""

    name = "numba"

    def __call__(self, splats: Splats, view: View, settings: RenderSettings) -> Rendering:
        """Rasterize `splats` seen from `view`. Differentiable in every tensor of `splats`. Raises
        ValueError: shapes do not fit together, or the camera cannot be."""
        projected = _project(_in_float32(splats), _in_float32(view), settings)
        rgb, alpha, depth = _Rasterize.apply(
            projected.means2d,
            projected.conics,
            projected.depths,
            projected.opacities,
            projected.colors,
            projected.radii,
            Grid(view.width, view.height, -(-view.width // TILE), -(-view.height // TILE)),
            settings.absgrad,
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
    """(means2d, conics, depths, opacities, colors [N, 3]) -> colours, alpha, sum of w z."""

    @staticmethod
    def forward(ctx, means2d, conics, depths, opacities, colors, radii, grid, absgrad):  # type: ignore[override]
        gaussians = tuple(map(flat, (means2d, conics, depths, opacities, colors)))
        rgb = empty(grid.height, grid.width, 3)
        alpha, depth = (empty(grid.height, grid.width, 1) for _ in range(2))
        state = np.empty((2, grid.tiles_x * grid.tiles_y * AREA), np.float32)
        lists = tile_lists(gaussians, flat(radii), grid, ALPHA_CUTOFF)
        launch(draw_frame, lists, grid, Frame(*map(flat, (rgb, depth, alpha)), *state), _LIMITS)
        ctx.save_for_backward(rgb, depth, alpha)
        ctx.state = (lists, state, grid, absgrad)
        ctx.means2d = means2d
        return rgb, alpha, depth

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad_rgb, grad_alpha, grad_depth):  # type: ignore[override]
        lists, state, grid, absgrad = ctx.state
        frame = Frame(*map(flat, ctx.saved_tensors), *state)
        pulled = Frame(flat(grad_rgb), flat(grad_depth), flat(grad_alpha), *state)
        sums = torch.zeros(ctx.means2d.shape[1], WIDTH, dtype=torch.float32)  # of those not drawn 0
        grads = np.empty(lists.ranks.size * WIDTH, np.float32)
        launch(backward_frame, lists, grid, frame, pulled, _LIMITS, grads)
        launch(sum_rows, lists, grads, flat(sums))
        means2d, absolute, conics, opacities, colors, depths = sums.split((2, 2, 3, 1, 3, 1), dim=1)
        if absgrad:
            ctx.means2d.absgrad = absolute[None]
        return means2d[None], conics, depths[:, 0], opacities[:, 0], colors, None, None, None


def compile_drawing() -> None:
    """Launch the kernels that draw, in a process that compiles them; `runtime` starts one where it
    must, and beside it one with `compile_colors`.

    What a kernel becomes may depend on what the process has compiled before (a product of three
    numbers is taken in another order), so each kernel is always compiled in the same process, in
    the order of a step.
    """
    runtime.compiles_here = True
    shapes = ((1, 3), (1, 4), (1, 3), (1,), (1, 3))
    means, *others = (torch.ones(shape, requires_grad=True) for shape in shapes)
    matrix = torch.diag(torch.tensor([16.0, 16.0, 1.0]))
    view, settings = View(torch.eye(4), matrix, 16, 16), RenderSettings(True, True, True)
    drawn = NumbaRasterizer()(Splats(means, *others, sh_degree=None), view, settings)
    (drawn.rgb.sum() + drawn.alpha.sum()).backward()


def compile_colors() -> None:
    """As `compile_drawing`, the kernels of spherical harmonics and of losses."""
    from desplat_ns.backend.ssim import compiled_photometric

    runtime.compiles_here = True
    means, coefficients = (torch.ones(1, *n, requires_grad=True) for n in ((3,), (4, 3)))
    radii = torch.ones(1, dtype=torch.int32)
    EvaluateColors.apply(means, coefficients, radii, torch.zeros(3), 1).sum().backward()  # type: ignore[union-attr]
    image = torch.zeros(16, 16, 3, requires_grad=True)
    compiled_photometric(torch.zeros(16, 16, 3), None, 0.0, 1.0, image)[0].backward()
