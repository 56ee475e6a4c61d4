"""The renderer once more, in 60 decimal digits: a truth that extreme scenes cannot spoil.

Written with mpmath from the same papers as `tests/backend/reference.py`, one pixel and one Gaussian
at a time. Nothing is culled. Derivatives are central differences with a step of 1e-18, whose error
of about 1e-36 is far below what float64 resolves. Slow: for a few Gaussians on a few pixels.

Letters in shapes: N Gaussians, P pixels, F features (red, green, blue, 1, depth).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from mpmath import mp, mpf

from desplat_ns.backend import RenderSettings
from desplat_ns.backend.constants import EPS2D
from tests.backend.scenes import PARAMETERS, TestScene
from tests.stability.cases import Case
from tests.stability.measure import ByFloat64, Truth

mp.dps = 60

CUTOFF, CLAMP, STOP, FOV = mpf(1) / 255, mpf("0.999"), mpf("1e-4"), mpf("1.3")
STEP = mpf("1e-18")
FLOOR = mpf("1e-6")
"""Least ratio of determinants that antialiasing takes a root of: the package's COMPENSATION_MIN
squared. What it changes lies below the cutoff."""

Vector = list[Any]


@dataclass
class Precise:
    """Sums of w f over the Gaussians of each pixel, and their derivatives."""

    values: np.ndarray
    """[P, F]."""
    slopes: dict[str, np.ndarray]
    """By parameter, [N, components, P, F]."""

    def gradients(self, factor: np.ndarray) -> dict[str, np.ndarray]:
        """Of sum(factor * values), by parameter, [N, components]."""
        return {name: np.einsum("ncpf,pf->nc", s, factor) for name, s in self.slopes.items()}


def dot(a: Vector, b: Vector) -> Any:
    return sum((x * y for x, y in zip(a, b, strict=True)), mpf(0))


def numbers(tensor: Any) -> Any:
    """A tensor as nested lists of exact numbers."""
    values = tensor.detach().double().tolist()

    def exact(v: Any) -> Any:
        return [exact(x) for x in v] if isinstance(v, list) else mpf(v)

    return exact(values)


def rotation_columns(q: Vector) -> list[Vector]:
    """The action of a quaternion of any length on the axes."""
    norm2 = dot(q, q)
    w, x, y, z = q
    return [
        [(w * w + x * x - y * y - z * z) / norm2, 2 * (x * y + w * z) / norm2,
         2 * (x * z - w * y) / norm2],
        [2 * (x * y - w * z) / norm2, (w * w - x * x + y * y - z * z) / norm2,
         2 * (y * z + w * x) / norm2],
        [2 * (x * z + w * y) / norm2, 2 * (y * z - w * x) / norm2,
         (w * w - x * x - y * y + z * z) / norm2],
    ]  # fmt: skip


class Scene:
    """A scene of exact numbers."""

    def __init__(self, scene: TestScene, settings: RenderSettings):
        self.viewmat, self.K, self.size = numbers(scene.viewmat), numbers(scene.K), scene.size
        self.degree, self.settings = scene.sh_degree, settings
        self.gaussians = [
            [numbers(getattr(scene, name)[i].reshape(-1)) for name in PARAMETERS]
            for i in range(len(scene.means))
        ]
        width, height = scene.size
        # Kept while a derivative is taken: equal depths would change places.
        depths = [self.camera(g[0])[2] for g in self.gaussians]
        self.order = sorted(range(len(depths)), key=lambda i: (depths[i], i))
        self.pixels = [
            (mpf(2 * x + 1) / 2, mpf(2 * y + 1) / 2) for y in range(height) for x in range(width)
        ]

    def camera(self, mean: Vector) -> Vector:
        return [dot(row[:3], mean) + row[3] for row in self.viewmat[:3]]

    def covariance(self, gaussian: list[Vector]) -> tuple[Any, Any, Any]:
        """xx, xy, yy of J W Sigma W^T J^T."""
        place, columns = self.camera(gaussian[0]), rotation_columns(gaussian[1])
        ahead, rows = self.viewmat[2][:3], []
        for axis in range(2):
            f, c = self.K[axis][axis], self.K[axis][2]
            beyond = (FOV - 1) * self.size[axis] / (2 * f)
            low, high = -(c / f + beyond), (self.size[axis] - c) / f + beyond
            slope = min(max(place[axis] / place[2], low), high)
            aside = self.viewmat[axis][:3]
            world = [f / place[2] * (a - slope * d) for a, d in zip(aside, ahead, strict=True)]
            rows.append([dot(world, c) * s for c, s in zip(columns, gaussian[2], strict=True)])
        return dot(rows[0], rows[0]), dot(rows[0], rows[1]), dot(rows[1], rows[1])

    def alphas(self, gaussian: list[Vector]) -> list[Any]:
        """Opacity at each pixel, before cutoff and clamp."""
        x, y, z = self.camera(gaussian[0])
        mean = (self.K[0][0] * x / z + self.K[0][2], self.K[1][1] * y / z + self.K[1][2])
        xx, xy, yy = self.covariance(gaussian)
        sharp = xx * yy - xy * xy
        xx, yy = xx + mpf(EPS2D), yy + mpf(EPS2D)
        det = xx * yy - xy * xy
        opacity = gaussian[3][0]
        if self.settings.antialiased:
            opacity *= mp.sqrt(max(sharp / det, FLOOR))
        opacities = []
        for pixel in self.pixels:
            dx, dy = pixel[0] - mean[0], pixel[1] - mean[1]
            power = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (2 * det)
            opacities.append(opacity * mp.exp(-power))
        return opacities

    def features(self, gaussian: list[Vector]) -> Vector:
        """Red, green, blue, 1, depth."""
        colors = gaussian[4]
        if self.degree is not None:
            colors = self.evaluated(gaussian)
        return [*colors, mpf(1), self.camera(gaussian[0])[2]]

    def evaluated(self, gaussian: list[Vector]) -> Vector:
        """max(SH + 1/2, 0), degrees 0 and 1."""
        assert self.degree is not None and self.degree <= 1
        columns = list(zip(*(row[:3] for row in self.viewmat[:3]), strict=True))
        translation = [row[3] for row in self.viewmat[:3]]
        ray = [m + dot(list(c), translation) for m, c in zip(gaussian[0], columns, strict=True)]
        length = mp.sqrt(dot(ray, ray))
        x, y, z = (r / length for r in ray)
        first = mp.sqrt(3 / (4 * mp.pi))
        basis = [mp.sqrt(1 / (4 * mp.pi)), -first * y, first * z, -first * x]
        used = basis[: (self.degree + 1) ** 2]
        return [
            max(dot(used, gaussian[4][c::3][: len(used)]) + mpf(1) / 2, mpf(0)) for c in range(3)
        ]

    def composite(self, alphas: list[list[Any]], features: list[Vector]) -> list[Vector]:
        """Sums of w f, front to back, for each pixel."""
        images = []
        for p in range(len(self.pixels)):
            clear, image = mpf(1), [mpf(0)] * 5
            for i in self.order:
                alpha = min(alphas[i][p], CLAMP)
                if alpha < CUTOFF:
                    continue
                if clear * (1 - alpha) <= STOP:
                    break
                image = [v + alpha * clear * f for v, f in zip(image, features[i], strict=True)]
                clear *= 1 - alpha
            images.append(image)
        return images


def render(scene: TestScene, settings: RenderSettings) -> Precise:
    """Values and all derivatives of a scene whose every Gaussian is drawn."""
    exact = Scene(scene, settings)
    count = len(exact.gaussians)
    alphas = [exact.alphas(g) for g in exact.gaussians]
    features = [exact.features(g) for g in exact.gaussians]

    def moved(i: int, kind: int, component: int, by: Any) -> list[Vector]:
        gaussian = [list(values) for values in exact.gaussians[i]]
        gaussian[kind][component] += by
        a, f = list(alphas), list(features)
        if kind != 4:
            a[i] = exact.alphas(gaussian)
        f[i] = exact.features(gaussian)
        return exact.composite(a, f)

    slopes = {}
    for kind, name in enumerate(PARAMETERS):
        components = getattr(scene, name)[0].numel() if count else 0
        derivatives = np.zeros((count, components, len(exact.pixels), 5))
        for i in range(count):
            step = STEP * max(mpf(1), *(abs(v) for v in exact.gaussians[i][kind]))
            if name == "quats":
                step = STEP * mp.sqrt(dot(exact.gaussians[i][kind], exact.gaussians[i][kind]))
            for c in range(components):
                pair = (moved(i, kind, c, step), moved(i, kind, c, -step))
                derivatives[i, c] = [
                    [float((a - b) / (2 * step)) for a, b in zip(*images, strict=True)]
                    for images in zip(*pair, strict=True)
                ]
        slopes[name] = derivatives
    values = [[float(v) for v in image] for image in exact.composite(alphas, features)]
    return Precise(np.array(values).reshape(-1, 5), slopes)


def truth(case: Case) -> Truth:
    """Values and gradients of a case of the catalogue without the error of float64."""
    return render(case.drawn, case.settings) if case.by_mpmath else ByFloat64(case)
