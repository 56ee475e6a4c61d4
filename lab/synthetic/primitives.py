"""The four solids of which everything is built, and where rays meet them.

`intersect` returns the ray parameter of the nearest hit in front of the origin, infinity where
there is none. Rays start outside of solids. `surface` describes points that lie on the surface.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from lab.synthetic.textures import Texture, f32

RAY_START = 1e-3
"""Hits nearer than this ray parameter do not count: a shadow ray must not meet its own surface."""


@runtime_checkable
class Primitive(Protocol):
    """A solid with a texture."""

    @property
    def texture(self) -> Texture: ...

    def bounds(self) -> tuple[Float[np.ndarray, "3"], float]:
        """Centre and radius (metres) of a sphere around the solid."""
        ...

    def intersect(
        self, origins: Float[np.ndarray, "3 *#R"], directions: Float[np.ndarray, "3 *#R"]
    ) -> Float[np.ndarray, "*R"]: ...

    def surface(
        self, points: Float[np.ndarray, "3 N"]
    ) -> tuple[Float[np.ndarray, "3 N"], Float[np.ndarray, "2 N"]]:
        """Unit outward normals and texture coordinates (metres)."""
        ...


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product over the first axis, which holds x, y and z."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _column(vector: Float[np.ndarray, "3"], like: np.ndarray) -> np.ndarray:
    """`vector` in float32, shaped to broadcast against "3 *R"."""
    return f32(vector).reshape(3, *[1] * (like.ndim - 1))


def _turn(rotation: Float[np.ndarray, "3 3"], vectors: np.ndarray) -> np.ndarray:
    return np.tensordot(f32(rotation), vectors, axes=1)


def _near_root(a: np.ndarray, half_b: np.ndarray, c: np.ndarray) -> Float[np.ndarray, "*R"]:
    """Smaller root of a t^2 + 2 half_b t + c where it lies in front, else infinity."""
    discriminant = half_b * half_b - a * c
    with np.errstate(invalid="ignore", divide="ignore"):
        t = (-half_b - np.sqrt(discriminant)) / a
    return np.where((discriminant > 0) & (t > RAY_START), t, np.float32(np.inf))


@dataclass(frozen=True)
class Sphere:
    center: Float[np.ndarray, "3"]
    radius: float
    texture: Texture

    def bounds(self) -> tuple[Float[np.ndarray, "3"], float]:
        return self.center, self.radius

    def intersect(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        offset = origins - _column(self.center, origins)
        c = dot(offset, offset) - np.float32(self.radius**2)
        return _near_root(dot(directions, directions), dot(offset, directions), c)

    def surface(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        normals = (points - _column(self.center, points)) / np.float32(self.radius)
        longitude = np.arctan2(normals[1], normals[0])
        latitude = np.arcsin(np.clip(normals[2], -1, 1))
        return normals, np.float32(self.radius) * np.stack([longitude, latitude])


@dataclass(frozen=True)
class Capsule:
    """A cylinder with round ends."""

    start: Float[np.ndarray, "3"]
    end: Float[np.ndarray, "3"]
    radius: float
    texture: Texture

    def _axis(self) -> tuple[Float[np.ndarray, "3"], float]:
        length = float(np.linalg.norm(self.end - self.start))
        return (self.end - self.start) / length, length

    def bounds(self) -> tuple[Float[np.ndarray, "3"], float]:
        return (self.start + self.end) / 2, self._axis()[1] / 2 + self.radius

    def intersect(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        axis, length = self._axis()
        axis = _column(axis, origins)
        offset = origins - _column(self.start, origins)
        o_along, d_along = dot(offset, axis), dot(directions, axis)
        o_across, d_across = offset - o_along * axis, directions - d_along * axis
        c = dot(o_across, o_across) - np.float32(self.radius**2)
        t = _near_root(dot(d_across, d_across), dot(o_across, d_across), c)
        with np.errstate(invalid="ignore"):
            along = o_along + t * d_along
            side = np.where((along > 0) & (along < length), t, np.float32(np.inf))
        ends = [Sphere(end, self.radius, self.texture) for end in (self.start, self.end)]
        caps = [end.intersect(origins, directions) for end in ends]
        return np.minimum(side, np.minimum(*caps))

    def surface(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        axis, length = self._axis()
        offset = points - _column(self.start, points)
        along = dot(offset, _column(axis, points))
        foot = np.clip(along, 0, np.float32(length)) * _column(axis, points)
        normals = (offset - foot) / np.float32(self.radius)
        side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        angle = np.arctan2(
            dot(normals, _column(np.cross(axis, side), points)), dot(normals, _column(side, points))
        )
        return normals, np.stack([np.float32(self.radius) * angle, along])


@dataclass(frozen=True)
class Box:
    """`rotation` takes the box's own axes to the world's."""

    center: Float[np.ndarray, "3"]
    half_size: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    texture: Texture

    def bounds(self) -> tuple[Float[np.ndarray, "3"], float]:
        return self.center, float(np.linalg.norm(self.half_size))

    def _local(self, points: np.ndarray) -> np.ndarray:
        return _turn(self.rotation.T, points - _column(self.center, points))

    def intersect(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        origin, direction = self._local(origins), _turn(self.rotation.T, directions)
        half = _column(self.half_size, origin)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (-half - origin) / direction, (half - origin) / direction
        enter = np.fmax.reduce(np.minimum(first, second))
        leave = np.fmin.reduce(np.maximum(first, second))
        return np.where((enter < leave) & (enter > RAY_START), enter, np.float32(np.inf))

    def surface(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        local = self._local(points)
        face = np.argmax(np.abs(local) / _column(self.half_size, local), axis=0)
        sign = np.sign(np.take_along_axis(local, face[None], axis=0))[0]
        normals = f32(self.rotation)[:, face] * sign
        u = np.where(face == 0, local[1], local[0])
        v = np.where(face == 2, local[1], local[2])
        # The faces of one axis get separate parts of the texture.
        return normals, np.stack([u + 3 * face, v]).astype(np.float32)


@dataclass(frozen=True)
class Rect:
    """A flat rectangle with corners at `corner` + {0, 1} `u` + {0, 1} `v`, u perpendicular to v."""

    corner: Float[np.ndarray, "3"]
    u: Float[np.ndarray, "3"]
    v: Float[np.ndarray, "3"]
    texture: Texture

    def bounds(self) -> tuple[Float[np.ndarray, "3"], float]:
        return self.corner + (self.u + self.v) / 2, float(np.linalg.norm(self.u + self.v)) / 2

    def intersect(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        normal = _column(np.cross(self.u, self.v), origins)
        offset = origins - _column(self.corner, origins)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -dot(offset, normal) / dot(directions, normal)
            hit = offset + t * directions
            a = dot(hit, _column(self.u / (self.u @ self.u), hit))
            b = dot(hit, _column(self.v / (self.v @ self.v), hit))
            inside = (a >= 0) & (a <= 1) & (b >= 0) & (b <= 1) & (t > RAY_START)
        return np.where(inside, t, np.float32(np.inf))

    def surface(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        normal = np.cross(self.u, self.v)
        normal /= np.linalg.norm(normal)
        offset = points - _column(self.corner, points)
        a = dot(offset, _column(self.u / np.linalg.norm(self.u), points))
        b = dot(offset, _column(self.v / np.linalg.norm(self.v), points))
        return np.repeat(f32(normal)[:, None], points.shape[1], axis=1), np.stack([a, b])
