"""The compiled part of `backend/ssim.py`: L1 and mean SSIM of two images, and the gradient of both.

With G the 11-tap Gaussian window (along y, then x, wherever it lies within the image), mx = G x,
my = G y, vx = G x^2 - mx^2, vy = G y^2 - my^2, c = G xy - mx my,

    SSIM = l s,    l = (2 mx my + C1) / (mx^2 + my^2 + C1),    s = (2 c + C2) / (vx + vy + C2)

(Wang et al. 2004, Eq. 13). With P, Q, R the derivatives of sum SSIM by mx, G x^2 and G xy,

    d sum SSIM / dx = G'P + 2 x G'Q + y G'R,

where G' is G over a border of zeros. In L1 a pixel counts by 1 - kept * weight, the
distractors' one; for SSIM y is blended with x by it, as a constant.

A worker goes down a strip of COLUMNS numbers, ROWS rows at a time: it sums SSIM over their windows,
whose P, Q, R stay in the processor's caches, and blurs these, with those of the windows above, to
the gradient of the rows. Written to memory and read again they took a third of the time. Images are
read as they lie in memory, [H, W, 3]: a row is 3 W numbers, neighbours of one channel 3 apart. They
are copied into scratch rows.

Scratch rows have one fixed length, STRIDE: only then can the compiler see that nothing overlaps,
and use vectors. Rows of y lie IMAGE numbers behind those of x; rows of Q and of R lie SLOPES and
2 SLOPES behind those of P. Products are made anew in each window: to keep them in rows of their own
takes a tenth to a sixth more time.
"""

import math

import numba
import numpy as np
import torch
from torch import Tensor

from desplat_ns.backend.numba_kernels.runtime import empty, flat, kernel, launch, part, pieces
from desplat_ns.backend.ssim import C1, C2, MARGIN, WINDOW

CHANNELS = 3

SIDE = MARGIN * CHANNELS
"""Numbers of a row that the window needs beyond those it yields."""

ROWS, COLUMNS = 16, 480
"""Size of the block that comes out."""

STRIDE = 544
"""Length of a scratch row: COLUMNS + 2 SIDE, and not near a power of two (see `pixels.PLANE`)."""

IMAGE = (ROWS + 2 * MARGIN) * STRIDE
"""Length of the scratch rows of one image."""

SLOPES = (ROWS + MARGIN) * STRIDE
"""The same of P, of Q and of R."""

_TAPS = [math.exp(-((k - 5) ** 2) / (2 * 1.5**2)) for k in range(WINDOW)]
_W0, _W1, _W2, _W3, _W4, _W5 = (np.float32(t / math.fsum(_TAPS)) for t in _TAPS[:6])

LOOSE = {"reassoc", "contract", "nsz"}
"""What the compiler may do with sums here."""

ALONG = np.uint64(CHANNELS)
"""From a number to that of the next pixel."""

_DOWN = np.uint64(STRIDE)
_N3, _N4, _N5 = (np.uint64(k) for k in range(3, 6))
P1, P2, P3 = (np.uint64(k * STRIDE) for k in range(1, 4))
"""Where the second, third and fourth of several rows begin."""

NEXT, OF_Q, OF_R = np.uint64(IMAGE), np.uint64(SLOPES), np.uint64(2 * SLOPES)

BAND = 4
"""Blocks that a worker goes down at a time. Above the first it scores MARGIN rows that another one
scores as well."""

_C1, _C2 = np.float32(C1), np.float32(C2)

_ZERO, _ONE, _TWO = np.float32(0), np.float32(1), np.float32(2)


@part(fastmath=LOOSE)
def _value(a, i):
    return a[i]


@part(fastmath=LOOSE)
def _squares(a, i):
    x, y = a[i], a[NEXT + i]
    return x * x + y * y


@part(fastmath=LOOSE)
def _product(a, i):
    return a[i] * a[NEXT + i]


@part(fastmath=LOOSE)
def _blur_of(of, a, i, step):
    """The symmetric window over what `of` makes of a at i, i + step, ... i + 10 step."""
    s1, s2, s3, s4, s5 = step, step + step, step * _N3, step * _N4, step * _N5
    i = i + s5
    near = _W5 * of(a, i) + _W4 * (of(a, i - s1) + of(a, i + s1))
    near += _W3 * (of(a, i - s2) + of(a, i + s2))
    far = _W2 * (of(a, i - s3) + of(a, i + s3)) + _W1 * (of(a, i - s4) + of(a, i + s4))
    return near + far + _W0 * (of(a, i - s5) + of(a, i + s5))


@part(fastmath=LOOSE)
def blur(a, i, step):
    """The symmetric window over a[i], a[i + step], ... a[i + 10 step]."""
    return _blur_of(_value, a, i, step)


@part(fastmath=LOOSE)
def moments(s, v, row, columns):
    """Means of x, y, x^2 + y^2, x y down the window from a scratch row on, into the rows of v."""
    first = np.uint64(row * STRIDE)
    for j in range(np.uint64(columns)):
        i = first + j
        v[j] = blur(s, i, _DOWN)
        v[P1 + j] = blur(s, i + NEXT, _DOWN)
        v[P2 + j] = _blur_of(_squares, s, i, _DOWN)
        v[P3 + j] = _blur_of(_product, s, i, _DOWN)


@part(fastmath=LOOSE)
def blur_slopes(slopes, v, row, columns):
    """P, Q, R down the window from a scratch row on, into the rows of v."""
    first = np.uint64(row * STRIDE)
    for j in range(np.uint64(columns)):
        v[j] = blur(slopes, first + j, _DOWN)
        v[P1 + j] = blur(slopes, OF_Q + first + j, _DOWN)
        v[P2 + j] = blur(slopes, OF_R + first + j, _DOWN)


@part()
def _copy_in(source, length, row, column, rows, columns, s):
    """Copy a part of an image whose rows are `length` long into scratch rows."""
    for r in range(rows):
        first, to = np.uint64((row + r) * length + column), np.uint64(r * STRIDE)
        for j in range(np.uint64(columns)):
            s[to + j] = source[first + j]


@part()
def _spread(weight, length, row, column, columns, o):
    """A part of a row of `weight`, which has one number for each pixel, for all three channels."""
    first = np.uint64((row * length + column) // CHANNELS)
    for p in range(np.uint64(columns // CHANNELS)):
        for k in range(CHANNELS):
            o[CHANNELS * p + np.uint64(k)] = weight[first + p]


@part()
def _blend_in(y, weight, length, row, column, rows, columns, s, o):
    """As `_copy_in`, of y behind x, which is in the scratch rows, blended with x by the weight."""
    for r in range(rows):
        _spread(weight, length, row + r, column, columns, o)
        first, to = np.uint64((row + r) * length + column), np.uint64(r * STRIDE)
        for j in range(np.uint64(columns)):
            s[NEXT + to + j] = o[j] * s[to + j] + (_ONE - o[j]) * y[first + j]


@part(fastmath=LOOSE)
def _scores(v, s, at, first, end):
    """Sum of SSIM over windows of a row; their P, Q, R go into the three rows of s."""
    total = np.float32(0)
    for j in range(np.uint64(first), np.uint64(end)):
        mx, my = blur(v, j, ALONG), blur(v, P1 + j, ALONG)
        squares, xy = blur(v, P2 + j, ALONG), blur(v, P3 + j, ALONG)
        means = mx * mx + my * my
        per_means, per_variances = _ONE / (means + _C1), _ONE / (squares - means + _C2)
        luminance = (_TWO * mx * my + _C1) * per_means
        structure = (_TWO * (xy - mx * my) + _C2) * per_variances
        score = luminance * structure
        total += score
        q, r = -score * per_variances, _TWO * luminance * per_variances
        s[at + j] = _TWO * structure * (my - mx * luminance) * per_means - _TWO * mx * q - my * r
        s[at + OF_Q + j] = q
        s[at + OF_R + j] = r
    return total


@part()
def _clear(values, first, end):
    for i in range(np.uint64(first), np.uint64(end)):
        values[i] = _ZERO


@part()
def _score(images, length, windows, block, first, scratch):
    """Sum of SSIM over a block's windows; P, Q, R of these, and of those from row `first` on.

    In the scratch rows of P, Q, R the block's first row has number MARGIN, its first number SIDE.
    """
    (x, y, weight), (row, rows, column, columns), (s, v, slopes, o) = images, block, scratch
    left, end = min(column, SIDE), min(row + rows, windows)
    count, total = min(column + columns, length - SIDE) - column + left, 0.0
    if end > first and count > 0:
        part = length, first, column - left, end - first + MARGIN, count + SIDE
        _copy_in(x, *part, s)
        _blend_in(y, weight, *part, s, o)
    for r in range(first, row + rows):
        number = count if r < end and count > 0 else 0
        if number > 0:
            moments(s, v, r - first, number + SIDE)
            to = np.uint64((r - row + MARGIN) * STRIDE + SIDE - left)
            _scores(v, slopes, to, 0, min(left, count))
            own = _scores(v, slopes, to, left, count)
            total += own if r >= row else _ZERO
        for k in range(3):
            at = k * SLOPES + (r - row + MARGIN) * STRIDE + SIDE - left
            _clear(slopes, at - SIDE + left, at)
            _clear(slopes, at + number, at + left + columns)
    return total


@part()
def _go_on(slopes):
    """P, Q, R of the last windows of a block become those above the next one."""
    for k in range(0, 3 * SLOPES, SLOPES):
        for i in range(np.uint64(k), np.uint64(k + MARGIN * STRIDE)):
            slopes[i] = slopes[i + np.uint64(ROWS * STRIDE)]


@part(fastmath=LOOSE)
def _mix(v, x, y, o, kept, gradient, at, columns, scale, scale_l1):
    """One row of the gradient of a block, from P, Q, R blurred down the window; gives its L1."""
    first, total = np.uint64(at), np.float32(0)
    for j in range(np.uint64(columns)):
        p, q = blur(v, j, ALONG), blur(v, P1 + j, ALONG)
        r = blur(v, P2 + j, ALONG)
        here, there, counted = x[first + j], y[first + j], _ONE - kept * o[j]
        off = here - there
        total += counted * abs(off)
        sign = np.float32(off > 0) - np.float32(off < 0)
        blended = o[j] * here + (_ONE - o[j]) * there
        slope = p + _TWO * here * q + blended * r
        gradient[first + j] = scale * slope + scale_l1 * (counted * sign)
    return total


@part()
def _differentiate(images, length, block, rates, scratch, gradient):
    """The gradient of a block, and its L1."""
    (x, y, weight), (row, rows, column, columns), (_, v, slopes, o) = images, block, scratch
    kept, scale, scale_l1 = rates
    total = 0.0
    for r in range(rows):
        blur_slopes(slopes, v, r, columns + SIDE)
        _spread(weight, length, row + r, column, columns, o)
        at = (row + r) * length + column
        total += _mix(v, x, y, o, kept, gradient, at, columns, scale, scale_l1)
    return total


@part()
def _go_down(images, shape, wanted, rates, blocks, strip, scratch, sums, gradient):
    """Work on the blocks of a strip from one to before another."""
    (height, length), (similarity, difference) = shape, sums
    column, slopes, above = strip * COLUMNS, scratch[2], False
    for i in range(*blocks):
        row = i * ROWS
        block = row, min(ROWS, height - row), column, min(COLUMNS, length - column)
        is_scored = wanted[i : i + 2, strip : strip + 2].any()
        if is_scored:
            if above:
                _go_on(slopes)
            elif row == 0:
                _clear(slopes, 0, slopes.size)
            first = row if above or row == 0 else row - MARGIN
            similarity[i, strip] = _score(images, length, height - MARGIN, block, first, scratch)
        if wanted[i, strip]:
            difference[i, strip] = _differentiate(images, length, block, rates, scratch, gradient)
        else:
            for r in range(row, row + block[1]):
                _clear(gradient, r * length + column, r * length + column + block[3])
        above = is_scored


@kernel(parallel=True)
def score_image(images, shape, wanted, rates, sums, gradient, counter, workers):
    """Sums of SSIM and of L1 of x and y over blocks, and the gradient by x.

    Args:
        images: x and y; and the weight of the distractors.
        shape: rows of an image, and numbers in one.
        wanted: whether a block is, [down, across]. Of others, those whose windows reach one that is
            have their SSIM summed, and all have no gradient.
        rates: what L1 loses at weight 1; the result's gradient by the sum of SSIM, and
            by that of L1.
        sums: of SSIM over a block's windows and of L1 over its pixels, [down, across].
        gradient: like x.
    """
    down, strips = sums[0].shape
    bands = (down + BAND - 1) // BAND
    for _ in numba.prange(workers):
        s, slopes = np.empty(2 * IMAGE, np.float32), np.empty(3 * SLOPES, np.float32)
        scratch = s, np.empty(4 * STRIDE, np.float32), slopes, np.empty(STRIDE, np.float32)
        for piece in pieces(counter, bands * strips):
            first = piece // strips * BAND
            blocks = first, min(first + BAND, down)
            _go_down(images, shape, wanted, rates, blocks, piece % strips, scratch, sums, gradient)


class Photometric(torch.autograd.Function):
    """(photo, distractor weight or None, leak, weight of SSIM, one image or two) -> the loss of
    each; see `backend/ssim.py`. The gradient is worked out with the value, as most of the work is.
    """

    @staticmethod
    def forward(ctx, photo, weight, leak, ssim_weight, *images):  # type: ignore[override]
        height, length = photo.shape[0], photo.shape[1] * CHANNELS
        per_window = ssim_weight / ((height - MARGIN) * (length - SIDE))
        per_number = (1 - ssim_weight) / (height * length)
        rates = np.float32(1 - leak), np.float32(-per_window), np.float32(per_number)
        similarity, difference = np.empty((2, -(-height // ROWS), -(-length // COLUMNS)))
        weight = photo.new_zeros(height, photo.shape[1], 1) if weight is None else weight
        wanted = np.ones(similarity.shape, bool)
        losses, gradients = [], []
        for place, image in enumerate(images):
            if place == 1:
                wanted, weight = _blocks_of(weight, similarity.shape[1]), torch.zeros_like(weight)
            gradient = empty(*photo.shape)
            launch(
                *(score_image, (flat(image), flat(photo), flat(weight)), (height, length), wanted),
                *(rates, (similarity, difference), flat(gradient)),
            )
            value = ssim_weight - per_window * similarity.sum() + per_number * difference.sum()
            losses.append(torch.tensor(value, dtype=torch.float32))
            gradients.append(gradient)
        ctx.save_for_backward(*gradients)
        return tuple(losses)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads):  # type: ignore[override]
        by_image = zip(grads, ctx.saved_tensors, strict=True)
        scaled = (saved if grad == 1 else grad * saved for grad, saved in by_image)
        return None, None, None, None, *scaled


def _blocks_of(weight: Tensor, across: int) -> np.ndarray:
    """Blocks [down, across] in which any of the weights [H, W, 1] is above 0."""
    pixels = weight[..., 0].numpy()
    rows = [pixels[row : row + ROWS].max(axis=0) for row in range(0, len(pixels), ROWS)]
    columns = np.arange(across) * (COLUMNS // CHANNELS)
    return np.maximum.reduceat(np.stack(rows), columns, axis=1) > 0
