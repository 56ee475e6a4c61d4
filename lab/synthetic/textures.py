"""Procedural textures: colour as a function of surface coordinates in metres."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

Color = tuple[float, float, float]
"""Red, green, blue in [0, 1]."""

_LATTICE = 64
"""Noise repeats after this many cells; no surface of the yard has that many."""


def f32(values: Sequence[Any] | np.ndarray) -> np.ndarray:
    """In float32: half the memory traffic, and far finer than a pixel."""
    return np.asarray(values, dtype=np.float32)


@runtime_checkable
class Texture(Protocol):
    """Colour of a surface."""

    def __call__(self, uv: Float[np.ndarray, "2 N"]) -> Float[np.ndarray, "3 N"]:
        """Colour in [0, 1] at surface coordinates `uv` (metres)."""
        ...


@cache
def _lattice(seed: int) -> Float[np.ndarray, "64 64"]:
    return np.random.default_rng(seed).random((_LATTICE, _LATTICE), dtype=np.float32)


def hash_noise(cells: Int[np.ndarray, "2 N"], seed: int) -> Float[np.ndarray, " N"]:
    """One random number in [0, 1) for each integer cell."""
    return _lattice(seed)[cells[0] & (_LATTICE - 1), cells[1] & (_LATTICE - 1)]


def value_noise(uv: Float[np.ndarray, "2 N"], seed: int) -> Float[np.ndarray, " N"]:
    """Smooth noise in [0, 1): random values at integer coordinates, smoothstep between them."""
    cells = np.floor(uv).astype(np.int32)
    u, v = uv - cells
    u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
    x, y = cells
    corner = [hash_noise(np.stack([x + i, y + j]), seed) for j in (0, 1) for i in (0, 1)]
    below = corner[0] + u * (corner[1] - corner[0])
    above = corner[2] + u * (corner[3] - corner[2])
    return below + v * (above - below)


def _pick(
    choose_first: Bool[np.ndarray, " N"], first: Color, second: Color
) -> Float[np.ndarray, "3 N"]:
    return np.where(choose_first, f32(first)[:, None], f32(second)[:, None])


@dataclass(frozen=True)
class Plain:
    """One colour."""

    color: Color

    def __call__(self, uv: Float[np.ndarray, "2 N"]) -> Float[np.ndarray, "3 N"]:
        return np.repeat(f32(self.color)[:, None], uv.shape[1], axis=1)


@dataclass(frozen=True)
class Checker:
    """Squares of side `size` (metres)."""

    first: Color
    second: Color
    size: float

    def __call__(self, uv: Float[np.ndarray, "2 N"]) -> Float[np.ndarray, "3 N"]:
        cells = np.floor(uv / np.float32(self.size)).astype(np.int32)
        return _pick((cells[0] + cells[1]) % 2 == 0, self.first, self.second)


@dataclass(frozen=True)
class Stripes:
    """Bands of `width` (metres) across the second coordinate, turned by `slant` (radians)."""

    first: Color
    second: Color
    width: float
    slant: float = 0.0

    def __call__(self, uv: Float[np.ndarray, "2 N"]) -> Float[np.ndarray, "3 N"]:
        across = uv[0] * np.float32(np.sin(self.slant)) + uv[1] * np.float32(np.cos(self.slant))
        band = np.floor(across / np.float32(self.width)).astype(np.int32)
        return _pick(band % 2 == 0, self.first, self.second)


@dataclass(frozen=True)
class Dots:
    """Discs of diameter `size` / 2 on a square grid of pitch `size` (metres)."""

    dot: Color
    ground: Color
    size: float

    def __call__(self, uv: Float[np.ndarray, "2 N"]) -> Float[np.ndarray, "3 N"]:
        cell = uv / np.float32(self.size)
        u, v = cell - np.floor(cell) - np.float32(0.5)
        return _pick(u * u + v * v < 1 / 16, self.dot, self.ground)


@dataclass(frozen=True)
class Bricks:
    """Courses of bricks or slabs, each of its own shade, with joints between them (metres)."""

    brick: Color
    joint: Color
    size: tuple[float, float]
    gap: float
    shade: float = 0.35
    """Brightness differs from brick to brick by up to this fraction."""
    shift: float = 0.5
    """How far one course is shifted against the next, in bricks."""
    seed: int = 0

    def __call__(self, uv: Float[np.ndarray, "2 N"]) -> Float[np.ndarray, "3 N"]:
        width, height = f32(self.size)
        row = np.floor(uv[1] / height)
        along = uv[0] / width + (row % 2) * np.float32(self.shift)
        column = np.floor(along)
        is_joint = (along - column) * width < self.gap
        is_joint |= uv[1] - row * height < self.gap
        shade = hash_noise(np.stack([column, row]).astype(np.int32), self.seed)
        tint = f32(self.brick)[:, None] * (1 - np.float32(self.shade) * shade)
        return np.where(is_joint, f32(self.joint)[:, None], tint)


@dataclass(frozen=True)
class Grained:
    """Another texture, mottled by two octaves of noise."""

    base: Texture
    strength: float
    """Range of the brightness, as a fraction of the base's."""
    scale: tuple[float, float]
    """Size of the coarse grain along both coordinates, metres."""
    seed: int = 1

    def __call__(self, uv: Float[np.ndarray, "2 N"]) -> Float[np.ndarray, "3 N"]:
        cells = uv / f32(self.scale)[:, None]
        noise = 0.6 * value_noise(cells, self.seed) + 0.4 * value_noise(3 * cells, self.seed + 1)
        return self.base(uv) * (1 + np.float32(self.strength) * (0.4 - noise.astype(np.float32)))


@dataclass(frozen=True)
class Glossy:
    """Another texture under varnish: `render.shade` adds what it reflects."""

    base: Texture
    share: float
    """Of the light that comes from where the surface mirrors the camera's ray."""

    def __call__(self, uv: Float[np.ndarray, "2 N"]) -> Float[np.ndarray, "3 N"]:
        return self.base(uv)
