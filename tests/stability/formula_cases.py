"""The catalogue's second part: hard inputs for the formulas outside of the rasterizers.

Each case knows its exact answer in closed form, and the bound is a number of roundings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from mpmath import mp, mpf
from torch import Tensor, nn

from desplat_ns.backend.ssim import ssim
from desplat_ns.gaussians.activation import MAX_LOG_SCALE, activate_static, clamp_colors, sigmoid
from desplat_ns.losses import photometric_loss
from desplat_ns.photo_tourism.appearance import AffineAppearance
from desplat_ns.photo_tourism.config import AppearanceConfig
from desplat_ns.rendering.layers import composite_alpha, composite_color, over_background

SSIM_C1, SSIM_C2 = mpf("1e-4"), mpf("9e-4")
"""0.01^2 and 0.03^2 (Wang et al. 2004)."""


@dataclass(frozen=True)
class Pair:
    """What was computed, what is true, and how far they may lie apart. Same shapes."""

    got: Tensor
    want: Tensor
    bound: Tensor | float

    @property
    def error(self) -> float:
        return (self.got.detach().double() - self.want).abs().max().item()

    @property
    def share(self) -> float:
        """Largest error as a share of its bound; 0 / 0 is 0."""
        off = (self.got.detach().double() - self.want).abs()
        return torch.where(off > 0, off / self.bound, 0.0).max().item()

    @property
    def within(self) -> bool:
        return bool(self.got.isfinite().all()) and self.share <= 1


@dataclass(frozen=True)
class FormulaCase:
    """One hard input of one formula."""

    name: str
    promise: str
    run: Callable[[torch.dtype], tuple[Pair, Pair]]
    """Of a dtype: values, gradients."""


def roundoff(dtype: torch.dtype) -> float:
    """u, the error of one rounding."""
    return torch.finfo(dtype).eps / 2


def slope_of(output: Tensor, leaf: Tensor) -> Tensor:
    (slope,) = torch.autograd.grad(output.sum(), leaf)
    return slope


def nearly_opaque(dtype: torch.dtype) -> tuple[Pair, Pair]:
    """c_d + (1 - alpha_d) c_s; the gradient of what is behind is 1 - alpha_d."""
    u = roundoff(dtype)
    values = [0.0, 0.5, 0.999, 1 - 2.0**-20, 1 - u, 1.0]
    alpha = torch.tensor(values, dtype=dtype).reshape(-1, 1, 1)
    front = (alpha * 0.75).expand(-1, 1, 3)
    behind = torch.full((len(values), 1, 3), 0.625, dtype=dtype, requires_grad=True)
    got = composite_color(front, alpha, behind)
    clear = 1 - alpha.double()
    want = front.double() + clear * 0.625
    # 1 - alpha, the product and the sum are rounded; 1 - alpha is exact where alpha >= 1/2.
    return Pair(got, want, 3 * u), Pair(slope_of(got, behind), clear.expand(-1, 1, 3), u * clear)


def nothing_left_for_the_background(dtype: torch.dtype) -> tuple[Pair, Pair]:
    """Two layers over white: the background's weight is (1 - alpha_d)(1 - alpha_s)."""
    u = roundoff(dtype)
    values = [[a, b] for a in (0.0, 0.999, 1.0) for b in (0.0, 0.999, 1.0)]
    pair = torch.tensor(values, dtype=dtype)
    alpha_d, alpha_s = (pair[:, k].reshape(-1, 1, 1).clone() for k in (0, 1))
    background = torch.ones(3, dtype=dtype).expand(len(values), 1, 3).clone().requires_grad_()
    alpha = composite_alpha(alpha_d, alpha_s)
    got = over_background(torch.zeros(len(values), 1, 3, dtype=dtype), alpha, background)
    clear = ((1 - alpha_d.double()) * (1 - alpha_s.double())).expand(-1, 1, 3)
    # alpha is near 1, so that 1 - alpha has its absolute error, not its relative one.
    return Pair(got, clear, 6 * u), Pair(slope_of(got, background), clear, 4 * u)


def colours_under_the_clamp(dtype: torch.dtype) -> tuple[Pair, Pair]:
    values = [-1e38, -1.0, -1e-30, -0.0, 0.0, 1e-30, 0.5, 1.0, 1 + 1e-6, 1e38, 0.25, 0.75]
    rgbs = torch.tensor(values, dtype=dtype).reshape(-1, 3).requires_grad_()
    exact = rgbs.detach().double()
    inside = ((exact >= 0) & (exact <= 1)).double()
    got = clamp_colors(rgbs)
    return Pair(got, exact.clamp(0, 1), 0.0), Pair(slope_of(got, rgbs), inside, 0.0)


def logits_far_out(dtype: torch.dtype) -> tuple[Pair, Pair]:
    u = roundoff(dtype)
    logits = torch.tensor([-1e30, -1e4, -90, -20, -1, -0.0, 0, 1, 20, 90, 1e4, 1e30], dtype=dtype)
    logits.requires_grad_()
    exact = [mpf(v) for v in logits.detach().double().tolist()]
    # exp underflows to 0 long before.
    y = [1 / (1 + mp.exp(-v)) if abs(v) < 1e4 else mpf(v > 0) for v in exact]
    want = torch.tensor([float(v) for v in y], dtype=torch.float64)
    slope = torch.tensor([float(v * (1 - v)) for v in y], dtype=torch.float64)
    got = sigmoid(logits)
    return Pair(got, want, 6 * u), Pair(slope_of(got, logits), slope, 8 * u)


def log_scales_far_out(dtype: torch.dtype) -> tuple[Pair, Pair]:
    """exp, of which gradients are as large as values: both relative."""
    u = roundoff(dtype)
    values = [[-1e4, -200.0, -88.0], [-40.0, 0.0, 40.0], [79.0, 89.0, 1e4]]
    raw = torch.tensor(values, dtype=dtype, requires_grad=True)
    params = {
        "means": torch.zeros(3, 3, dtype=dtype), "scales": raw,
        "quats": torch.ones(3, 4, dtype=dtype), "opacities": torch.zeros(3, 1, dtype=dtype),
        "features_dc": torch.zeros(3, 3, dtype=dtype),
        "features_rest": torch.zeros(3, 0, 3, dtype=dtype),
    }  # fmt: skip
    got = activate_static(params, 0).scales
    want = raw.detach().double().clamp(max=MAX_LOG_SCALE).exp()
    slope = torch.where(raw.detach() > MAX_LOG_SCALE, 0.0, want)
    tiny = torch.finfo(dtype).tiny
    return (
        Pair(got, want, 4 * u * want + tiny),
        Pair(slope_of(got, raw), slope, 4 * u * slope + tiny),
    )


def ssim_error(dtype: torch.dtype) -> float:
    """Bound on the SSIM of images whose variance is 0, from docs/dev/stability.md.

    Float64 goes through pytorch_msssim, whose window is rounded to float32.
    """
    window = 22 * roundoff(torch.float32) if dtype == torch.float64 else 0.0
    return (22 * roundoff(dtype) + window) / float(SSIM_C2)


def flat_images(dtype: torch.dtype) -> tuple[Pair, Pair]:
    """Without variance, SSIM = (2 a b + C1) / (a^2 + b^2 + C1); the gradients of its pixels sum up
    to the derivative by a."""
    got, want, slopes, derivative = [], [], [], []
    for a, b in ((0.0, 0.0), (1.0, 1.0), (0.5, 0.25), (0.0, 1.0), (1e-3, 2e-3)):
        pred = torch.full((13, 15, 3), a, dtype=dtype, requires_grad=True)
        value = ssim(pred, torch.full((13, 15, 3), b, dtype=dtype))
        x, y = (mpf(t.item()) for t in (pred[0, 0, 0], torch.tensor(b, dtype=dtype)))
        top, bottom = 2 * x * y + SSIM_C1, x * x + y * y + SSIM_C1
        got.append(value.detach())
        want.append(float(top / bottom))
        slopes.append(slope_of(value, pred).sum())
        derivative.append(float((2 * y * bottom - 2 * x * top) / bottom**2))
    error = ssim_error(dtype)
    exact = torch.tensor(want, dtype=torch.float64)
    slope = torch.tensor(derivative, dtype=torch.float64)
    # A gradient divides by a mean square or a variance once more: at most 1 / C1 or 1 / C2.
    return Pair(torch.stack(got), exact, error), Pair(
        torch.stack(slopes), slope, error * (slope.abs() + 2 / float(SSIM_C2))
    )


def all_pixels_masked(dtype: torch.dtype) -> tuple[Pair, Pair]:
    """Where distractors own every pixel, the static scene has nothing to learn from the photo."""
    rng = torch.Generator().manual_seed(3)
    static, photo = torch.rand(2, 14, 17, 3, generator=rng, dtype=torch.float64).to(dtype)
    static.requires_grad_()
    owned = torch.ones(14, 17, 1, dtype=dtype)
    got = photometric_loss(static, photo, 0.2, owned)
    zero = torch.zeros(14, 17, 3, dtype=torch.float64)
    bound, slope = 0.2 * ssim_error(dtype), slope_of(got, static)
    return Pair(got, zero.sum(), bound), Pair(slope, zero, 10 * bound)


def embeddings_far_out(dtype: torch.dtype) -> tuple[Pair, Pair]:
    """beta and gamma of Eq. 6 and their gradients by the embedding, against 80-bit numbers.

    A sum of n products has n roundings, and what a layer is given is off by those before it: in all
    as many as there are terms along the way, of the size of the same sums without signs.
    """
    rng = torch.Generator().manual_seed(5)
    config = AppearanceConfig(embedding_dim=4, fourier_frequencies=1, hidden_width=8, mlp_scale=1.0)
    mlp = AffineAppearance(config).to(dtype)
    for parameter in mlp.parameters():
        parameter.data = torch.randn(parameter.shape, generator=rng).to(dtype)
    own = torch.rand(5, 9, generator=rng).to(dtype)
    embedding = torch.tensor([1e4, -1e4, 1e4, 1e-4], dtype=dtype, requires_grad=True)
    got = torch.cat(mlp.tones(embedding, own[:, :6], own[:, 6:]), dim=1)

    layers = [_exact_layer(layer) for layer in (mlp.body[0], mlp.body[2], mlp.head)]
    rows = torch.cat([embedding.detach().expand(5, 4), own], dim=1)
    value, active = rows.double().numpy().astype(np.longdouble), []
    size, terms = np.abs(value), 2
    for weight, bias in layers:
        value, size = value @ weight.T + bias, size @ np.abs(weight).T + np.abs(bias)
        active.append(value > 0)
        value = np.maximum(value, 0) if len(active) < len(layers) else value
        terms += weight.shape[1] + 2
    value[:, 3:] += 1  # gamma
    slope = slope_size = np.ones_like(value)
    for (weight, _), on in zip(layers[::-1], [None, *active[-2::-1]], strict=True):
        slope = slope if on is None else slope * on
        slope, slope_size = slope @ weight, slope_size @ np.abs(weight)
        terms += weight.shape[0] + 2
    slope, slope_size = slope[:, :4].sum(0), slope_size[:, :4].sum(0)

    u, double = roundoff(dtype), lambda x: torch.from_numpy(np.asarray(x, np.float64))
    return (
        Pair(got, double(value), terms * u * (double(size) + 1)),
        Pair(slope_of(got, embedding), double(slope), terms * u * double(slope_size)),
    )


def _exact_layer(layer: nn.Module) -> tuple[np.ndarray, np.ndarray]:
    assert isinstance(layer, nn.Linear)
    weight, bias = (p.detach().double().numpy() for p in (layer.weight, layer.bias))
    return weight.astype(np.longdouble), bias.astype(np.longdouble)


FORMULA_CASES = (
    FormulaCase(
        "alpha_d -> 1 and a gradient wanted behind",
        "the share 1 - alpha_d reaches what is behind, to one rounding; exactly 0 at 1",
        nearly_opaque,
    ),
    FormulaCase(
        "both layers opaque before the background",
        "the background's weight is within 4 roundings of (1 - alpha_d)(1 - alpha_s)",
        nothing_left_for_the_background,
    ),
    FormulaCase(
        "distractor colours beyond [0, 1] under the clamp",
        "exact; gradient 1 on the closed range, 0 beyond",
        colours_under_the_clamp,
    ),
    FormulaCase("opacity logits to +-1e30", "within 6 roundings, in [0, 1]", logits_far_out),
    FormulaCase(
        "log-scales to +-1e4",
        f"finite; no gradient above {MAX_LOG_SCALE:g}",
        log_scales_far_out,
    ),
    FormulaCase("flat images under SSIM", "finite and right within the bound", flat_images),
    FormulaCase("all pixels masked", "loss and gradient 0 within SSIM's bound", all_pixels_masked),
    FormulaCase(
        "embeddings at 1e4 in the appearance MLP",
        "finite, within a rounding for each term of its sums",
        embeddings_far_out,
    ),
)
"""All of the catalogue."""
