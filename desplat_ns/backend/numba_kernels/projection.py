"""The projection of `projection.py`, compiled: same formulas, same culling, analytic gradients.

With M = J W R diag(s), 2 x 3 with rows A and B (J W: how the pixel moves with the world position),

    xx, xy, yy = A.A + eps, A.B, B.B + eps,    m = A x B,    det = m.m + eps (xx + yy - eps),
    conic      = (up yy, -xy, up xx) / det.

The backward pass follows the same chain from its end. Gaussians are worked on in batches that lie
in planes (see `pixels`), so that one vector instruction serves eight of them; lanes of culled
ones may hold anything, NaN included, and are left out where results are written. Gradients of
culled Gaussians are 0, whatever comes back for them.
"""

from typing import NamedTuple

import numba
import numpy as np
import torch

from desplat_ns.backend import projection
from desplat_ns.backend.constants import EPS2D, FAR_PLANE, NEAR_PLANE
from desplat_ns.backend.inputs import MIN_QUAT_NORM
from desplat_ns.backend.numba_kernels.runtime import batches, empty, flat, kernel, launch, part
from desplat_ns.backend.protocol import View

PLANES = 19

BATCH = 64
"""Gaussians worked on together."""

LANE = BATCH + 16
"""Distance between planes (see `pixels.PLANE`)."""

(
    X, Y, Z, QW, QX, QY, QZ, SX, SY, SZ, OPACITY,
    MEAN_X, MEAN_Y, CONIC_A, CONIC_B, CONIC_C, DEPTH, OUT_OPACITY, RADIUS,
) = (np.uint64(LANE * k) for k in range(PLANES))  # fmt: skip
"""Where the planes start: the parameters, then what is projected (or its gradients)."""

_LANES = np.uint64(BATCH)

_CONTRACT = {"contract", "nsz"}
"""Fused multiply-add is welcome; NaN and infinities must stay what they are."""

_ZERO, _HALF, _ONE, _TWO = (np.float32(x) for x in (0, 0.5, 1, 2))

_NEAR, _FAR, _EPS2D = map(np.float32, (NEAR_PLANE, FAR_PLANE, EPS2D))
_MOST, _UP = np.float32(projection.MAX_PIXELS), np.float32(1 + 4 * torch.finfo(torch.float32).eps)
_LEAST_RATIO = np.float32(projection.COMPENSATION_MIN**2)
_LEAST_NORM2 = np.float32(MIN_QUAT_NORM**2)


class Camera(NamedTuple):
    """A view and the settings, all float32."""

    world: tuple[tuple[np.float32, ...], ...]
    """Rows of [R | t], world to camera."""
    focal: tuple[np.float32, ...]
    center: tuple[np.float32, ...]
    size: tuple[np.float32, ...]
    slopes_low: tuple[np.float32, ...]
    slopes_high: tuple[np.float32, ...]
    reach: np.float32
    antialiased: np.float32
    """1 or 0."""


@part()
def camera_of(c):
    """The Camera of the numbers that `make_camera` lists."""
    return Camera(
        ((c[0], c[1], c[2], c[3]), (c[4], c[5], c[6], c[7]), (c[8], c[9], c[10], c[11])),
        (c[12], c[13]), (c[14], c[15]), (c[16], c[17]), (c[18], c[19]), (c[20], c[21]),
        c[22], c[23],
    )  # fmt: skip


@part(fastmath=_CONTRACT, inline="always")
def _dot3(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part(fastmath=_CONTRACT, inline="always")
def _cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@part(fastmath=_CONTRACT, inline="always")
def _sum2(a, b, u, v):
    return (a[0] * u + b[0] * v, a[1] * u + b[1] * v, a[2] * u + b[2] * v)


@part(fastmath=_CONTRACT, inline="always")
def _sum3(a, b, c, u, v, w):
    return (
        a[0] * u + b[0] * v + c[0] * w,
        a[1] * u + b[1] * v + c[1] * w,
        a[2] * u + b[2] * v + c[2] * w,
    )


@part(fastmath=_CONTRACT, inline="always")
def _to_camera(row, x, y, z):
    return row[0] * x + row[1] * y + row[2] * z + row[3]


@part(fastmath=_CONTRACT, inline="always")
def _rotation(w, x, y, z):
    """Columns of the rotation matrix of a unit quaternion."""
    return (
        (_ONE - _TWO * (y * y + z * z), _TWO * (x * y + w * z), _TWO * (x * z - w * y)),
        (_TWO * (x * y - w * z), _ONE - _TWO * (x * x + z * z), _TWO * (y * z + w * x)),
        (_TWO * (x * z + w * y), _TWO * (y * z - w * x), _ONE - _TWO * (x * x + y * y)),
    )


@part(fastmath=_CONTRACT, inline="always")
def _pixel_row(axis, camera, slope, per_z):
    """A row of J W: how this pixel coordinate moves with the world position."""
    w, d, f = camera.world[axis], camera.world[2], camera.focal[axis] * per_z
    return (f * (w[0] - slope * d[0]), f * (w[1] - slope * d[1]), f * (w[2] - slope * d[2]))


@part(fastmath=_CONTRACT, inline="always")
def _axes(s, n, camera):
    """(x, y, z, 1/z), (slopes), rotation, length of the quaternion, rows of J W, of J W R, of M."""
    px, py, pz = s[X + n], s[Y + n], s[Z + n]
    x, y = _to_camera(camera.world[0], px, py, pz), _to_camera(camera.world[1], px, py, pz)
    z = _to_camera(camera.world[2], px, py, pz)
    per_z = _ONE / z
    slope_x = min(max(x * per_z, camera.slopes_low[0]), camera.slopes_high[0])
    slope_y = min(max(y * per_z, camera.slopes_low[1]), camera.slopes_high[1])
    qw, qx, qy, qz = s[QW + n], s[QX + n], s[QY + n], s[QZ + n]
    norm2 = qw * qw + qx * qx + qy * qy + qz * qz
    per = _ONE / np.sqrt(norm2)
    columns = _rotation(qw * per, qx * per, qy * per, qz * per)
    row_x = _pixel_row(0, camera, slope_x, per_z)
    row_y = _pixel_row(1, camera, slope_y, per_z)
    turned_x = (_dot3(row_x, columns[0]), _dot3(row_x, columns[1]), _dot3(row_x, columns[2]))
    turned_y = (_dot3(row_y, columns[0]), _dot3(row_y, columns[1]), _dot3(row_y, columns[2]))
    sx, sy, sz = s[SX + n], s[SY + n], s[SZ + n]
    a = (turned_x[0] * sx, turned_x[1] * sy, turned_x[2] * sz)
    b = (turned_y[0] * sx, turned_y[1] * sy, turned_y[2] * sz)
    place = (x, y, z, per_z)
    return place, (slope_x, slope_y), columns, norm2, (row_x, row_y), (turned_x, turned_y), (a, b)


@part(fastmath=_CONTRACT, inline="always")
def _shape(a, b):
    """xx, xy, yy with the low-pass, the minors, their squares' sum, and the determinant."""
    xx, xy, yy = _dot3(a, a) + _EPS2D, _dot3(a, b), _dot3(b, b) + _EPS2D
    minors = _cross(a, b)
    sharp = _dot3(minors, minors)
    return xx, xy, yy, minors, sharp, sharp + _EPS2D * (xx + yy - _EPS2D)


@part(fastmath=_CONTRACT, inline="always")
def _is_usable(s, n, place, norm2, camera):
    """Written so that every NaN makes it False."""
    x, y, z, _ = place
    pixels = max(camera.focal[0], camera.focal[1]) / max(z, _NEAR)
    good = (abs(x) * pixels < _MOST) & (abs(y) * pixels < _MOST)
    good &= (abs(s[SX + n]) * pixels < _MOST) & (abs(s[SY + n]) * pixels < _MOST)
    good &= (abs(s[SZ + n]) * pixels < _MOST) & (norm2 > _LEAST_NORM2)
    good &= (norm2 < np.float32(np.inf)) & (abs(s[OPACITY + n]) < np.float32(np.inf))
    good &= (z >= _NEAR) & (z <= _FAR)
    return good


@part(fastmath=_CONTRACT)
def project_batch(s, camera):
    """Fill the planes of what is projected; radius 0 where culled."""
    for n in range(_LANES):
        place, _, _, norm2, _, _, rows = _axes(s, n, camera)
        xx, xy, yy, _, sharp, det = _shape(rows[0], rows[1])
        usable = _is_usable(s, n, place, norm2, camera)
        per_det = _ONE / det
        kept = np.sqrt(max(sharp * per_det, _LEAST_RATIO))
        mean_x = camera.focal[0] * (place[0] * place[3]) + camera.center[0]
        mean_y = camera.focal[1] * (place[1] * place[3]) + camera.center[1]
        half = _HALF * (xx - yy)
        spread = np.sqrt(max(half * half + xy * xy, np.float32(0.01)))
        sigma = np.sqrt(_HALF * (xx + yy) + spread)
        radius = np.ceil(np.float32(3) * sigma)
        reach = max(radius, camera.reach * sigma)
        usable &= (mean_x + reach > _ZERO) & (mean_x - reach < camera.size[0])
        usable &= (mean_y + reach > _ZERO) & (mean_y - reach < camera.size[1])
        s[MEAN_X + n], s[MEAN_Y + n], s[DEPTH + n] = mean_x, mean_y, place[2]
        s[CONIC_A + n] = _UP * yy * per_det
        s[CONIC_B + n] = -xy * per_det
        s[CONIC_C + n] = _UP * xx * per_det
        s[OUT_OPACITY + n] = s[OPACITY + n] * (kept if camera.antialiased > _ZERO else _ONE)
        s[RADIUS + n] = radius if usable else _ZERO


@part(fastmath=_CONTRACT, inline="always")
def _backward_shape(s, n, a, b, camera):
    """Gradients by the rows of M, and by the opacity, from those by conic and opacity."""
    xx, xy, yy, minors, sharp, det = _shape(a, b)
    per_det = _ONE / det
    va, vb, vc = s[CONIC_A + n] * _UP, s[CONIC_B + n], s[CONIC_C + n] * _UP
    v_xx, v_xy, v_yy = vc * per_det, -vb * per_det, va * per_det
    v_det = -(v_yy * yy + v_xy * xy + v_xx * xx) * per_det
    ratio = sharp * per_det
    is_filtered = camera.antialiased > _ZERO
    kept = np.sqrt(max(ratio, _LEAST_RATIO)) if is_filtered else _ONE
    v_opacity = s[OUT_OPACITY + n]
    moves = is_filtered & (ratio > _LEAST_RATIO)
    v_ratio = _HALF * v_opacity * s[OPACITY + n] / kept if moves else _ZERO
    v_det -= v_ratio * ratio * per_det
    v_sharp = v_ratio * per_det + v_det
    v_xx, v_yy = _TWO * (v_xx + _EPS2D * v_det), _TWO * (v_yy + _EPS2D * v_det)
    # m = a x b, so dL/da = b x dL/dm and dL/db = dL/dm x a.
    v_sharp = _TWO * v_sharp
    v_minors = (v_sharp * minors[0], v_sharp * minors[1], v_sharp * minors[2])
    by_a, by_b = _cross(b, v_minors), _cross(v_minors, a)
    v_a, v_b = _sum3(by_a, a, b, _ONE, v_xx, v_xy), _sum3(by_b, b, a, _ONE, v_yy, v_xy)
    return v_a, v_b, v_opacity * kept


@part(fastmath=_CONTRACT, inline="always")
def _backward_quat(s, n, norm2, g0, g1, g2):
    """Gradient by the quaternion, of any length, from those by the columns of the rotation."""
    per = _ONE / np.sqrt(norm2)
    w, x, y, z = s[QW + n] * per, s[QX + n] * per, s[QY + n] * per, s[QZ + n] * per
    vw = _TWO * (x * (g1[2] - g2[1]) + y * (g2[0] - g0[2]) + z * (g0[1] - g1[0]))
    vx = w * (g1[2] - g2[1]) + y * (g1[0] + g0[1]) + z * (g2[0] + g0[2])
    vx = _TWO * (vx - _TWO * x * (g1[1] + g2[2]))
    vy = w * (g2[0] - g0[2]) + x * (g1[0] + g0[1]) + z * (g2[1] + g1[2])
    vy = _TWO * (vy - _TWO * y * (g0[0] + g2[2]))
    vz = w * (g0[1] - g1[0]) + x * (g2[0] + g0[2]) + y * (g2[1] + g1[2])
    vz = _TWO * (vz - _TWO * z * (g0[0] + g1[1]))
    along = w * vw + x * vx + y * vy + z * vz
    return (
        per * (vw - along * w), per * (vx - along * x),
        per * (vy - along * y), per * (vz - along * z),
    )  # fmt: skip


@part(fastmath=_CONTRACT, inline="always")
def _backward_row(axis, camera, slope, per_z, v):
    """Gradients by the slope and by 1/z of a row of J W."""
    w, d, f = camera.world[axis], camera.world[2], camera.focal[axis]
    by_per_z = f * (_dot3(v, w) - slope * _dot3(v, d))
    return -f * per_z * _dot3(v, d), by_per_z


@part(fastmath=_CONTRACT, inline="always")
def _backward_place(s, n, camera, place, slopes, v_rows):
    """Gradient by the mean in world coordinates."""
    x, y, _, per_z = place
    v_slope_x, v_x = _backward_row(0, camera, slopes[0], per_z, v_rows[0])
    v_slope_y, v_y = _backward_row(1, camera, slopes[1], per_z, v_rows[1])
    # A clamped slope does not move with the mean.
    u = (v_slope_x if slopes[0] == x * per_z else _ZERO) + camera.focal[0] * s[MEAN_X + n]
    v = (v_slope_y if slopes[1] == y * per_z else _ZERO) + camera.focal[1] * s[MEAN_Y + n]
    v_per_z = v_x + v_y + u * x + v * y
    gx, gy, gz = u * per_z, v * per_z, s[DEPTH + n] - v_per_z * per_z * per_z
    w0, w1, w2 = camera.world
    return _sum3(w0, w1, w2, gx, gy, gz)


@part(fastmath=_CONTRACT)
def backward_batch(s, camera):
    """Replace the planes of the parameters by their gradients."""
    for n in range(_LANES):
        place, slopes, columns, norm2, rows, turned, m = _axes(s, n, camera)
        v_a, v_b, v_opacity = _backward_shape(s, n, m[0], m[1], camera)
        sx, sy, sz = s[SX + n], s[SY + n], s[SZ + n]
        v_sx = v_a[0] * turned[0][0] + v_b[0] * turned[1][0]
        v_sy = v_a[1] * turned[0][1] + v_b[1] * turned[1][1]
        v_sz = v_a[2] * turned[0][2] + v_b[2] * turned[1][2]
        v_a = (v_a[0] * sx, v_a[1] * sy, v_a[2] * sz)
        v_b = (v_b[0] * sx, v_b[1] * sy, v_b[2] * sz)
        r, q = rows
        g0, g1 = _sum2(r, q, v_a[0], v_b[0]), _sum2(r, q, v_a[1], v_b[1])
        g2, (c0, c1, c2) = _sum2(r, q, v_a[2], v_b[2]), columns
        v_row_x = _sum3(c0, c1, c2, v_a[0], v_a[1], v_a[2])
        v_row_y = _sum3(c0, c1, c2, v_b[0], v_b[1], v_b[2])
        v_mean = _backward_place(s, n, camera, place, slopes, (v_row_x, v_row_y))
        v_quat = _backward_quat(s, n, norm2, g0, g1, g2)
        s[X + n], s[Y + n], s[Z + n] = v_mean
        s[QW + n], s[QX + n], s[QY + n], s[QZ + n] = v_quat
        s[SX + n], s[SY + n], s[SZ + n], s[OPACITY + n] = v_sx, v_sy, v_sz, v_opacity


def make_camera(view: View, antialiased: bool) -> np.ndarray:
    """The numbers of a Camera in their order: numba's parallel loops take no nested tuples."""
    rows, K = view.viewmat.tolist(), view.K.tolist()
    focal, center, size = (K[0][0], K[1][1]), (K[0][2], K[1][2]), (view.width, view.height)
    margins = [projection.FOV_MARGIN * 0.5 * n / f for n, f in zip(size, focal, strict=True)]
    axes = list(zip(focal, center, size, margins, strict=True))
    numbers = [*rows[0], *rows[1], *rows[2], *focal, *center, *size]
    numbers += [-(c / f + m) for f, c, _, m in axes]
    numbers += [(n - c) / f + m for f, c, n, m in axes]
    return np.array([*numbers, projection.REACH_SIGMAS, antialiased], np.float32)


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


@part()
def _load_parameters(parameters, first, number, s):
    means, quats, scales, opacities = parameters
    _load(means, 3, first, number, s, np.int64(X))
    _load(quats, 4, first, number, s, np.int64(QW))
    _load(scales, 3, first, number, s, np.int64(SX))
    _load(opacities, 1, first, number, s, np.int64(OPACITY))


@kernel(parallel=True)
def _project(parameters, projected, radii, numbers, counter, workers):
    """(means, quats, scales, opacities) -> (means2d, conics, depths, opacities), radii."""
    means2d, conics, depths, out_opacities = projected
    for _ in numba.prange(workers):
        s = np.ones(LANE * PLANES, np.float32)
        for first, end in batches(counter, radii.size, BATCH):
            number = end - first
            _load_parameters(parameters, first, number, s)
            project_batch(s, camera_of(numbers))
            for k in range(number):
                radii[first + k] = np.int32(s[np.int64(RADIUS) + k])
            _store(means2d, 2, first, number, s, np.int64(MEAN_X), radii)
            _store(conics, 3, first, number, s, np.int64(CONIC_A), radii)
            _store(depths, 1, first, number, s, np.int64(DEPTH), radii)
            _store(out_opacities, 1, first, number, s, np.int64(OUT_OPACITY), radii)


@kernel(parallel=True)
def _backward(parameters, pulled, gradients, radii, numbers, counter, workers):
    """Gradients by what was projected, `pulled`, to `gradients` by the parameters."""
    v_means2d, v_conics, v_depths, v_opacities = pulled
    by_means, by_quats, by_scales, by_opacities = gradients
    for _ in numba.prange(workers):
        s = np.ones(LANE * PLANES, np.float32)
        for first, end in batches(counter, radii.size, BATCH):
            number = end - first
            _load_parameters(parameters, first, number, s)
            _load(v_means2d, 2, first, number, s, np.int64(MEAN_X))
            _load(v_conics, 3, first, number, s, np.int64(CONIC_A))
            _load(v_depths, 1, first, number, s, np.int64(DEPTH))
            _load(v_opacities, 1, first, number, s, np.int64(OUT_OPACITY))
            backward_batch(s, camera_of(numbers))
            _store(by_means, 3, first, number, s, np.int64(X), radii)
            _store(by_quats, 4, first, number, s, np.int64(QW), radii)
            _store(by_scales, 3, first, number, s, np.int64(SX), radii)
            _store(by_opacities, 1, first, number, s, np.int64(OPACITY), radii)


class Project(torch.autograd.Function):
    """(means, quats, scales, opacities, camera, which may be drawn or None) -> means2d, conics,
    depths, opacities, radii."""

    @staticmethod
    def forward(ctx, means, quats, scales, opacities, camera, drawable=None):  # type: ignore[override]
        n = means.shape[0]
        out = empty(1, n, 2), empty(n, 3), empty(n), empty(n)
        radii = torch.empty(n, dtype=torch.int32)
        inputs = (means, quats, scales, opacities)
        ctx.save_for_backward(*inputs, radii)
        parameters, projected = tuple(map(flat, inputs)), tuple(map(flat, out))
        launch(_project, parameters, projected, radii.numpy(), camera)
        if drawable is not None:
            radii *= drawable
        ctx.mark_non_differentiable(radii)
        ctx.camera = camera
        return *out, radii

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads):  # type: ignore[override]
        *parameters, radii = map(flat, ctx.saved_tensors)
        n = radii.size
        out = empty(n, 3), empty(n, 4), empty(n, 3), empty(n)
        pulled, gradients = tuple(map(flat, grads[:4])), tuple(map(flat, out))
        launch(_backward, tuple(parameters), pulled, gradients, radii, ctx.camera)
        return *out, None, None
