"""Ray casting with a sun, shadows and light from the sky; supersampled."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lab.synthetic.cameras import PinholeCamera
from lab.synthetic.primitives import Primitive, dot
from lab.synthetic.textures import Glossy, f32

_SUN = f32([-0.3, -0.65, 0.8])
SUN = _SUN / np.linalg.norm(_SUN)
"""Direction towards the sun: behind the cameras, from the left."""

AMBIENT, DIRECT = 0.6, 0.6
"""Light from the sky on a surface that faces up, and from the sun at a right angle."""


LAMPS = ((0.5, 0.3, 0.8), (-0.7, 0.1, 0.7), (0.0, -0.8, 0.5))
"""Directions to lamps that glossy things mirror."""

SHARPNESS = 60.0
"""Exponent of a lamp's reflection (Phong): a highlight some 20 degrees wide."""


@dataclass(frozen=True)
class Sun:
    """Where the light of one photo comes from."""

    direction: tuple[float, float, float]
    """Unit vector towards the sun."""
    ambient: float = AMBIENT
    direct: float = DIRECT


STANDARD_SUN = Sun((float(SUN[0]), float(SUN[1]), float(SUN[2])))
"""Of every photo unless its daylight has a sun of its own."""


@dataclass(frozen=True)
class Samples:
    """One camera's samples, before they are averaged into pixels."""

    rgb: Float[np.ndarray, "3 h w"]
    depth: Float[np.ndarray, "h w"]
    """Metres along the optical axis; infinity where the sky is."""
    is_new: Bool[np.ndarray, "h w"]
    """Drawn by the last `draw`, not by the one before."""


def sky(camera: PinholeCamera, supersample: int) -> Samples:
    """Nothing but the sky: paler towards the horizon."""
    directions = camera.rays(supersample)
    up = directions[2] / np.sqrt(dot(directions, directions))
    blend = np.clip(up * 1.5, 0, 1)
    horizon, zenith = f32([0.86, 0.9, 0.94]), f32([0.35, 0.55, 0.85])
    rgb = horizon[:, None, None] * (1 - blend) + zenith[:, None, None] * blend
    return Samples(rgb, np.full(up.shape, np.inf, np.float32), np.zeros(up.shape, bool))


def _interval(
    position: float, depth: float, radius: float, focal: float, middle: float
) -> tuple[float, float]:
    """Pixels along one image axis between which a ball lies that is wholly before the camera.

    Looser than exact: the corners of the square around the ball are projected.
    """
    beside = [position - radius, position + radius]
    edges = np.divide.outer(beside, [depth - radius, depth + radius])
    return focal * float(edges.min()) + middle, focal * float(edges.max()) + middle


def window(primitive: Primitive, camera: PinholeCamera, supersample: int) -> tuple[slice, slice]:
    """Rows and columns of samples outside of which the primitive cannot be seen."""
    center, radius = primitive.bounds()
    local = camera.viewmat[:3, :3] @ center + camera.viewmat[:3, 3]
    depth = float(local[2])
    limits = []
    for axis, size in ((1, camera.height), (0, camera.width)):
        low, high = 0.0, float(size)
        if depth + radius <= 0:
            high = 0.0
        elif depth - radius > 1e-2:
            focal, middle = camera.K[axis, axis], camera.K[axis, 2]
            low, high = _interval(float(local[axis]), depth, radius, focal, middle)
        first, last = np.clip([low, high + 1], 0, size) * supersample
        limits.append(slice(int(first), int(np.ceil(last)) if high > 0 else 0))
    return limits[0], limits[1]


def draw(
    primitives: Sequence[Primitive],
    camera: PinholeCamera,
    supersample: int,
    behind: Samples,
    shadows_from: Sequence[Primitive] = (),
    sun: Sun = STANDARD_SUN,
) -> Samples:
    """`primitives` in front of (or hidden by) what `behind` already holds.

    Only `shadows_from` cast shadows. `behind` is not changed.
    """
    directions = camera.rays(supersample)
    origin = f32(camera.position)[:, None, None]
    casters = Casters(shadows_from)
    depth, owner = behind.depth.copy(), np.full(behind.depth.shape, -1, np.int32)
    for index, primitive in enumerate(primitives):
        rows, columns = window(primitive, camera, supersample)
        t = primitive.intersect(origin, directions[:, rows, columns])
        nearer = t < depth[rows, columns]
        depth[rows, columns][nearer] = t[nearer]
        owner[rows, columns][nearer] = index
    rgb = behind.rgb.copy()
    for index in np.unique(owner[owner >= 0]):
        mine = owner == index
        points = origin[:, :, 0] + depth[mine] * directions[:, mine]
        rgb[:, mine] = shade(primitives[index], points, casters, sun)
        if isinstance(primitives[index].texture, Glossy):
            rgb[:, mine] += reflection(primitives[index], points, directions[:, mine])
            rgb[:, mine] = np.clip(rgb[:, mine], 0, 1)
    return Samples(rgb, depth, owner >= 0)


class Casters:
    """What casts shadows, each in a ball."""

    def __init__(self, primitives: Sequence[Primitive]) -> None:
        self.primitives = primitives
        balls = [primitive.bounds() for primitive in primitives]
        self.centers = np.array([center for center, _ in balls]).reshape(-1, 3)
        self.radii = np.array([radius for _, radius in balls])

    def near(self, points: Float[np.ndarray, "3 N"], sun: Float[np.ndarray, "3"]) -> list[int]:
        """Those whose shade may reach a ball around all points."""
        low, high = points.min(axis=1), points.max(axis=1)
        offsets = self.centers - (low + high) / 2
        reach = self.radii + np.linalg.norm(high - low) / 2 + 1e-2
        along = offsets @ sun
        across2 = (offsets**2).sum(axis=1) - along**2
        return np.flatnonzero((across2 < reach**2) & (along > -reach)).tolist()


def shade(
    primitive: Primitive,
    points: Float[np.ndarray, "3 N"],
    casters: Casters,
    sun: Sun = STANDARD_SUN,
) -> Float[np.ndarray, "3 N"]:
    """Colour in [0, 1] of points on a matt surface, the same from every direction."""
    normals, uv = primitive.surface(points)
    toward_sun = dot(normals, f32(sun.direction))
    lit = toward_sun > 0
    if lit.any():
        lit[lit] = ~in_shadow(points[:, lit], casters, sun, primitive)
    light = sun.ambient * (0.8 + 0.2 * normals[2]) + sun.direct * np.where(lit, toward_sun, 0)
    return np.clip(primitive.texture(uv) * light, 0, 1)


def reflection(
    primitive: Primitive, points: Float[np.ndarray, "3 N"], directions: Float[np.ndarray, "3 N"]
) -> Float[np.ndarray, "3 N"]:
    """Light that a glossy surface mirrors into the camera, which `directions` come from."""
    assert isinstance(primitive.texture, Glossy)
    normals, _ = primitive.surface(points)
    rays = directions / np.sqrt(dot(directions, directions))
    return np.float32(primitive.texture.share) * mirrored(rays - 2 * dot(rays, normals) * normals)


def mirrored(directions: Float[np.ndarray, "3 N"]) -> Float[np.ndarray, "3 N"]:
    """Light in [0, 1] that comes from unit directions: dim walls, and lamps."""
    light = np.repeat(0.25 + 0.15 * directions[2:], 3, axis=0)
    for lamp in LAMPS:
        toward = f32(lamp) / np.float32(np.linalg.norm(lamp))
        light = light + np.maximum(dot(directions, toward[:, None]), 0) ** np.float32(SHARPNESS)
    return np.clip(light, 0, 1).astype(np.float32)


def in_shadow(
    points: Float[np.ndarray, "3 N"],
    casters: Casters,
    toward: Sun = STANDARD_SUN,
    itself: Primitive | None = None,
) -> Bool[np.ndarray, " N"]:
    """Whether a caster stands between each point and the sun, `itself` apart."""
    hidden = np.zeros(points.shape[1], bool)
    sun = f32(toward.direction)[:, None]
    for index in casters.near(points, sun[:, 0]):
        caster, radius = casters.primitives[index], float(casters.radii[index])
        if caster is itself:
            continue
        offset = f32(casters.centers[index])[:, None] - points
        along = dot(offset, sun)
        near = dot(offset, offset) - along * along < np.float32(radius**2)
        candidates = np.flatnonzero(near & (along > -radius) & ~hidden)
        if candidates.size:
            hits = caster.intersect(points[:, candidates], sun) < np.inf
            hidden[candidates[hits]] = True
    return hidden


def to_pixels(samples: Float[np.ndarray, "C h w"], supersample: int) -> Float[np.ndarray, "H W C"]:
    """Mean of the samples of each pixel."""
    channels, h, w = samples.shape
    blocks = samples.reshape(channels, h // supersample, supersample, w // supersample, supersample)
    return blocks.mean(axis=(2, 4)).transpose(1, 2, 0)


def to_uint8(rgb: Float[np.ndarray, "H W 3"]) -> np.ndarray:
    """8-bit picture, rounded to the nearest level."""
    return np.round(np.clip(rgb, 0, 1) * 255).astype(np.uint8)
