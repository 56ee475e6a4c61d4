"""What passes between camera and scene: people, balloons and parcels, anew for every view."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from desplat_ns.core.errors import ConfigError
from lab.synthetic.cameras import PinholeCamera
from lab.synthetic.primitives import Box, Capsule, Primitive, Sphere
from lab.synthetic.textures import Checker, Color, Dots, Grained, Plain, Stripes, Texture

_TRIES = 60
"""Occluders proposed for one view before the coverage asked for counts as out of reach."""


@dataclass(frozen=True)
class OccluderSpec:
    """Which occluders, and how much of a view they cover together."""

    kinds: tuple[str, ...] = ("person", "balloon", "parcel")
    """Drawn from with equal chance; a kind named twice is twice as likely."""
    min_fraction: float = 0.15
    """Occluders are added until a fraction of the image is covered that is drawn evenly between
    this and the middle of both limits."""
    max_fraction: float = 0.45
    """One that would lift the covered fraction above this is left out."""


def _color(rng: np.random.Generator) -> Color:
    """Near-white, near-black, or anything between, with equal chance."""
    low, high = [(0.93, 1.0), (0.0, 0.07), (0.1, 0.9)][rng.integers(3)]
    r, g, b = rng.uniform(low, high, 3).tolist()
    return r, g, b


def _texture(rng: np.random.Generator, size: float) -> Texture:
    """Plain, striped, dotted or checkered; `size` is the pattern's in metres."""
    first, second = _color(rng), _color(rng)
    patterns: list[Texture] = [
        Plain(first),
        Grained(Plain(first), 0.3, (size, size), int(rng.integers(100, 200))),
        Stripes(first, second, size, rng.uniform(0, np.pi)),
        Dots(first, second, 2 * size),
        Checker(first, second, size),
    ]
    return patterns[rng.integers(len(patterns))]


def _along(
    camera: PinholeCamera, pixel: tuple[float, float], depth: float
) -> Float[np.ndarray, "3"]:
    """World point at `depth` (metres) under a pixel given as fractions of width and height."""
    x, y = pixel[0] * camera.width, pixel[1] * camera.height
    ray = camera.viewmat[:3, :3].T @ np.linalg.inv(camera.K) @ np.array([x, y, 1.0])
    return camera.position + depth * ray


def person(camera: PinholeCamera, across: float, rng: np.random.Generator) -> list[Primitive]:
    """Somebody standing on the ground, between a waist-up view and a full figure."""
    feet = _along(camera, (across, 0.5), rng.uniform(1.7, 3.8)) * [1, 1, 0]
    facing = rng.uniform(0, 2 * np.pi)
    side = np.array([np.cos(facing), np.sin(facing), 0.0])
    ahead = np.array([-side[1], side[0], 0.0])
    up, tall = np.array([0.0, 0.0, 1.0]), rng.uniform(0.92, 1.08)
    shirt, trousers = _texture(rng, 0.07), Plain(_color(rng))
    skin = Plain([(0.93, 0.75, 0.62), (0.62, 0.42, 0.3), (0.36, 0.24, 0.18)][rng.integers(3)])
    parts: list[Primitive] = [
        Capsule(feet + 1.0 * tall * up, feet + 1.3 * tall * up, 0.2 * tall, shirt),
        Sphere(feet + 1.64 * tall * up, 0.13 * tall, skin),
        Sphere(feet + 1.67 * tall * up - 0.025 * ahead, 0.128 * tall, Plain(_color(rng))),
    ]
    for sign in (-1, 1):
        stride = rng.uniform(-0.25, 0.25) * ahead
        hip, foot = sign * 0.1 * side + 0.9 * tall * up, sign * 0.12 * side + stride + 0.07 * up
        parts.append(Capsule(feet + foot, feet + hip, 0.095 * tall, trousers))
        shoulder = sign * 0.22 * side + 1.38 * tall * up
        hand = sign * rng.uniform(0.28, 0.5) * side + rng.uniform(0.85, 1.2) * tall * up
        parts.append(Capsule(feet + shoulder, feet + hand + 0.1 * ahead, 0.06 * tall, shirt))
    return parts


def balloon(camera: PinholeCamera, across: float, rng: np.random.Generator) -> list[Primitive]:
    """A ball in the air, sometimes a cluster of three."""
    depth, radius = rng.uniform(1.3, 3.5), rng.uniform(0.15, 0.38)
    center = _along(camera, (across, rng.uniform(0.1, 0.9)), depth)
    shifts = [np.zeros(3)] if rng.random() < 0.6 else rng.uniform(-1, 1, (3, 3)) * 1.3 * radius
    return [Sphere(center + s, radius, _texture(rng, 0.4 * radius)) for s in shifts]


def parcel(camera: PinholeCamera, across: float, rng: np.random.Generator) -> list[Primitive]:
    """A box in the air, turned at random."""
    depth, half = rng.uniform(1.2, 3.2), rng.uniform(0.1, 0.38, 3)
    center = _along(camera, (across, rng.uniform(0.1, 0.9)), depth)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return [Box(center, half, rotation, _texture(rng, 0.07))]


KINDS: dict[str, Callable[[PinholeCamera, float, np.random.Generator], list[Primitive]]] = {
    "person": person,
    "balloon": balloon,
    "parcel": parcel,
}
"""To add a kind, write a function like these and name it here."""


class Effect(NamedTuple):
    """What a list of occluders does to a view."""

    covered: float
    """Fraction of the image that they hide."""
    worn_out: float
    """Fraction of the view's static points that they hide, but too many views do."""


def occluders_for_view(
    spec: OccluderSpec,
    camera: PinholeCamera,
    view: int,
    effect: Callable[[list[Primitive]], Effect],
    rng: np.random.Generator,
) -> list[Primitive]:
    """Occluders of the training view with index `view`.

    They come one by one, each at its own place across the image, until they cover as much as
    `spec` asks for. What would hide worn-out points is refused, less and less strictly.

    Raises ConfigError where `spec` cannot be met.
    """
    chosen, covered = list[Primitive](), 0.0
    wanted = rng.uniform(spec.min_fraction, (spec.min_fraction + spec.max_fraction) / 2)
    for turn in range(_TRIES):
        if covered >= wanted:
            return chosen
        # An evenly spread sequence over views and turns.
        across = (0.5 + view * 0.7548776662 + turn * 0.5698402910) % 1
        kind = spec.kinds[rng.integers(len(spec.kinds))]
        new = KINDS[kind](camera, across, rng)
        proposed = chosen + new
        now = effect(proposed)
        if covered < now.covered <= spec.max_fraction and now.worn_out <= (turn / _TRIES) ** 3:
            chosen, covered = proposed, now.covered
    raise ConfigError(
        f"{_TRIES} occluders were tried for view {view} and they cover {covered:.3f} of it; "
        f"{wanted:.3f} was needed. Widen the limits in OccluderSpec ({spec.min_fraction} to "
        f"{spec.max_fraction})."
    )
