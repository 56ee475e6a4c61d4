"""Projection for the numba backend: the formulas of `ewa` over all Gaussians, in parallel.

Gradients of culled Gaussians are 0, whatever comes back for them.
"""

from __future__ import annotations

import numba
import numpy as np
import torch

from desplat_ns.backend import projection
from desplat_ns.backend.constants import EPS2D, FAR_PLANE, NEAR_PLANE
from desplat_ns.backend.inputs import MIN_QUAT_NORM
from desplat_ns.backend.numba_kernels.ewa import (
    BATCH,
    CONIC_A,
    DEPTH,
    LANE,
    MEAN_X,
    OPACITY,
    OUT_OPACITY,
    PLANES,
    QW,
    RADIUS,
    SX,
    X,
    backward_batch,
    camera_of,
    project_batch,
)
from desplat_ns.backend.numba_kernels.runtime import (
    flat,
    kernel,
    launching,
    new_counter,
    num_workers,
    part,
    take,
)
from desplat_ns.backend.protocol import View

_ZERO = np.float32(0)


def make_camera(view: View, antialiased: bool) -> np.ndarray:
    """The numbers of a Camera in their order: numba's parallel loops take no nested tuples."""
    rows, K = view.viewmat.tolist(), view.K.tolist()
    focal, center, size = (K[0][0], K[1][1]), (K[0][2], K[1][2]), (view.width, view.height)
    margins = [projection.FOV_MARGIN * 0.5 * n / f for n, f in zip(size, focal, strict=True)]
    axes = list(zip(focal, center, size, margins, strict=True))
    numbers = [*rows[0], *rows[1], *rows[2], *focal, *center, *size]
    numbers += [-(c / f + m) for f, c, _, m in axes]
    numbers += [(n - c) / f + m for f, c, n, m in axes]
    numbers += [NEAR_PLANE, FAR_PLANE, EPS2D, antialiased]
    numbers += [1 + 4 * torch.finfo(torch.float32).eps, projection.MAX_PIXELS]
    numbers += [projection.REACH_SIGMAS, projection.COMPENSATION_MIN**2]
    return np.array([*numbers, MIN_QUAT_NORM**2], np.float32)


@part()
def _load(values, width, first, number, s, plane):
    """Rows first ... of a flat [N, width] array into `width` planes, from `plane` on."""
    for k in range(number):
        for column in range(width):
            s[plane + LANE * column + k] = values[(first + k) * width + column]


@part()
def _store(values, width, first, number, s, plane, radii):
    """The reverse; rows of culled Gaussians become 0."""
    for k in range(number):
        is_seen = radii[first + k] > 0
        for column in range(width):
            value = s[plane + LANE * column + k] if is_seen else _ZERO
            values[(first + k) * width + column] = value


@kernel(parallel=True)
def _project(parameters, projected, radii, numbers, counter, workers):
    """(means, quats, scales, opacities) -> (means2d, conics, depths, opacities), radii."""
    means, quats, scales, opacities = parameters
    means2d, conics, depths, out_opacities = projected
    for _ in numba.prange(workers):
        s = np.ones(LANE * PLANES, np.float32)
        first = take(counter) * BATCH
        while first < radii.size:
            number = min(BATCH, radii.size - first)
            _load(means, 3, first, number, s, np.int64(X))
            _load(quats, 4, first, number, s, np.int64(QW))
            _load(scales, 3, first, number, s, np.int64(SX))
            _load(opacities, 1, first, number, s, np.int64(OPACITY))
            project_batch(s, camera_of(numbers))
            for k in range(number):
                radii[first + k] = np.int32(s[np.int64(RADIUS) + k])
            _store(means2d, 2, first, number, s, np.int64(MEAN_X), radii)
            _store(conics, 3, first, number, s, np.int64(CONIC_A), radii)
            _store(depths, 1, first, number, s, np.int64(DEPTH), radii)
            _store(out_opacities, 1, first, number, s, np.int64(OUT_OPACITY), radii)
            first = take(counter) * BATCH


@kernel(parallel=True)
def _backward(parameters, pulled, gradients, radii, numbers, counter, workers):
    """Gradients by what was projected, `pulled`, to `gradients` by the parameters."""
    means, quats, scales, opacities = parameters
    v_means2d, v_conics, v_depths, v_opacities = pulled
    by_means, by_quats, by_scales, by_opacities = gradients
    for _ in numba.prange(workers):
        s = np.ones(LANE * PLANES, np.float32)
        first = take(counter) * BATCH
        while first < radii.size:
            number = min(BATCH, radii.size - first)
            _load(means, 3, first, number, s, np.int64(X))
            _load(quats, 4, first, number, s, np.int64(QW))
            _load(scales, 3, first, number, s, np.int64(SX))
            _load(opacities, 1, first, number, s, np.int64(OPACITY))
            _load(v_means2d, 2, first, number, s, np.int64(MEAN_X))
            _load(v_conics, 3, first, number, s, np.int64(CONIC_A))
            _load(v_depths, 1, first, number, s, np.int64(DEPTH))
            _load(v_opacities, 1, first, number, s, np.int64(OUT_OPACITY))
            backward_batch(s, camera_of(numbers))
            _store(by_means, 3, first, number, s, np.int64(X), radii)
            _store(by_quats, 4, first, number, s, np.int64(QW), radii)
            _store(by_scales, 3, first, number, s, np.int64(SX), radii)
            _store(by_opacities, 1, first, number, s, np.int64(OPACITY), radii)
            first = take(counter) * BATCH


class Project(torch.autograd.Function):
    """(means, quats, scales, opacities, camera, which may be drawn or None) -> means2d, conics,
    depths, opacities, radii."""

    @staticmethod
    def forward(ctx, means, quats, scales, opacities, camera, drawable=None):  # type: ignore[override]
        n = means.shape[0]
        out = torch.empty(1, n, 2), torch.empty(n, 3), torch.empty(n), torch.empty(n)
        radii = torch.empty(n, dtype=torch.int32)
        parameters = tuple(flat(t) for t in (means, quats, scales, opacities))
        with launching():
            projected = tuple(flat(t) for t in out)
            _project(parameters, projected, radii.numpy(), camera, new_counter(), num_workers())
        if drawable is not None:
            radii *= drawable
        ctx.mark_non_differentiable(radii)
        ctx.state = (parameters, radii.numpy(), camera)
        return *out, radii

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads):  # type: ignore[override]
        parameters, radii, camera = ctx.state
        n = radii.size
        out = torch.empty(n, 3), torch.empty(n, 4), torch.empty(n, 3), torch.empty(n)
        pulled, gradients = tuple(flat(g) for g in grads[:4]), tuple(flat(t) for t in out)
        with launching():
            _backward(parameters, pulled, gradients, radii, camera, new_counter(), num_workers())
        return *out, None, None
