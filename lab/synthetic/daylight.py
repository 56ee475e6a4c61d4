"""Day and weather in which a photo was taken: its light and its sky, drawn photo by photo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from desplat_ns.errors import ConfigError
from lab.synthetic.cameras import PinholeCamera
from lab.synthetic.light import Light, apply_light
from lab.synthetic.render import AMBIENT, DIRECT, SUN, Samples, Sun, to_pixels, to_uint8
from lab.synthetic.sky import Sky
from lab.synthetic.textures import Color

TINT_SPREAD = 0.04
"""Each channel of a photo's tint differs from its kind's by up to this fraction."""

SKY_SPREAD = 0.08
"""Each channel of a photo's sky is darker than its kind's by up to this fraction, ..."""

HAZE = 0.3
"""... and its zenith lies up to this far on the way to the horizon's colour."""


CLOUDED = 1 / 3
"""Share of the photos with a sun of their own in which a cloud is before it: ..."""

CLOUD = (0.25, 1.25)
"""... by these factors on the sun's light and on the light from the sky."""


@dataclass(frozen=True)
class DaylightKind:
    """Between which values the photos of one kind lie."""

    gain: tuple[float, float]
    gamma: tuple[float, float]
    tint: Color
    sky: Sky
    """Its azimuth is not used: every photo has its own."""


KINDS = {
    "noon": DaylightKind(
        gain=(0.95, 1.12),
        gamma=(0.95, 1.15),
        tint=(1.03, 1.0, 0.95),
        sky=Sky((0.74, 0.84, 0.93), (0.16, 0.38, 0.8), (0.12, 0.09, 0.04)),
    ),
    "overcast": DaylightKind(
        gain=(0.78, 0.95),
        gamma=(0.75, 0.9),
        tint=(0.95, 1.0, 1.05),
        sky=Sky((0.88, 0.89, 0.9), (0.7, 0.73, 0.77), (0.1, 0.1, 0.09)),
    ),
    "dusk": DaylightKind(
        gain=(0.68, 0.86),
        gamma=(1.05, 1.25),
        tint=(1.14, 0.95, 0.84),
        sky=Sky((0.9, 0.7, 0.62), (0.42, 0.46, 0.78), (0.1, 0.14, 0.04)),
    ),
}
"""To add a kind, name it here."""


@dataclass(frozen=True)
class Daylight:
    """What one photo was taken in."""

    kind: str
    light: Light
    sky: Sky | None
    """None: the sky of a scene without daylight, under this light."""
    sun: Sun | None = None
    """None: the sun of a scene without daylight."""


@dataclass(frozen=True)
class DaylightSpec:
    """Which daylight the photos are taken in, and how much of it shows."""

    kinds: tuple[str, ...] = ("noon", "overcast", "dusk")
    """As many photos of each; a kind named twice is twice as frequent."""
    strength: float = 1.0
    """Of the light, from 0 (the same in all photos) to 1. The sky does not depend on it."""
    sky: bool = True
    """Whether every photo has a sky of its own."""
    sun: float = 0.0
    """Degrees to either side by which photos differ in where the sun stands; a third of them has
    clouds before it. Shadows move and change then: no factor on a photo's colours undoes that."""
    plain_sky: Color | None = None
    """A sky of this one colour in all photos, whatever `sky` is, before each photo's light."""

    def __post_init__(self) -> None:
        unknown = sorted(set(self.kinds) - set(KINDS))
        if unknown or not self.kinds:
            raise ConfigError(
                f"Daylight of the kinds {unknown or '(none)'} is not known. Use some of "
                f"{sorted(KINDS)}."
            )
        if not 0 <= self.strength <= 1:
            raise ConfigError(f"Daylight's strength is {self.strength}. Choose it from 0 to 1.")
        if not 0 <= self.sun <= 180:
            raise ConfigError(f"Daylight's sun is {self.sun}. Choose it from 0 to 180 degrees.")


def draw_daylights(spec: DaylightSpec, count: int, rng: np.random.Generator) -> list[Daylight]:
    """The daylight of `count` photos: every kind equally often, in random order."""
    order = rng.permutation(np.arange(count) % len(spec.kinds))
    return [_draw_daylight(spec, spec.kinds[index], rng) for index in order]


def _draw_daylight(spec: DaylightSpec, name: str, rng: np.random.Generator) -> Daylight:
    kind = KINDS[name]
    tint = _scaled(kind.tint, 1 - TINT_SPREAD, 1 + TINT_SPREAD, rng)
    light = Light(rng.uniform(*kind.gain), tint, rng.uniform(*kind.gamma))
    horizon, zenith = (
        _scaled(color, 1 - SKY_SPREAD, 1.0, rng) for color in (kind.sky.horizon, kind.sky.zenith)
    )
    haze = rng.uniform(0, HAZE)
    r, g, b = (z + haze * (h - z) for h, z in zip(horizon, zenith, strict=True))
    sky = Sky(horizon, (r, g, b), kind.sky.glow, rng.uniform(0, 2 * np.pi))
    if spec.plain_sky is not None:
        sky = Sky(spec.plain_sky, spec.plain_sky, (0.0, 0.0, 0.0))
    shown = sky if spec.sky or spec.plain_sky is not None else None
    sun = _draw_sun(spec.sun, rng) if spec.sun > 0 else None
    return Daylight(name, light.scaled(spec.strength), shown, sun)


def _draw_sun(degrees: float, rng: np.random.Generator) -> Sun:
    """A sun that stands elsewhere: turned about the vertical by up to `degrees`, and clouded."""
    turn = np.radians(rng.uniform(-degrees, degrees))
    x, y, z = SUN.astype(np.float64)
    c, s = np.cos(turn), np.sin(turn)
    direct, ambient = CLOUD if rng.random() < CLOUDED else (1.0, 1.0)
    return Sun((c * x - s * y, s * x + c * y, float(z)), ambient * AMBIENT, direct * DIRECT)


def _scaled(color: Color, low: float, high: float, rng: np.random.Generator) -> Color:
    """Each channel times a factor of its own between `low` and `high`."""
    r, g, b = (np.array(color) * rng.uniform(low, high, 3)).tolist()
    return r, g, b


def develop(
    samples: Samples, camera: PinholeCamera, supersample: int, daylight: Daylight | None
) -> UInt8[np.ndarray, "H W 3"]:
    """The photo of what was drawn: its sky where nothing was hit, then its light on everything.

    Without daylight the samples are averaged and rounded, and that is all.
    """
    rgb = samples.rgb
    if daylight is not None and daylight.sky is not None:
        sky = daylight.sky.toward(camera.rays(supersample))
        rgb = np.where(np.isinf(samples.depth), sky, rgb)
    pixels = to_pixels(rgb, supersample)
    return to_uint8(pixels if daylight is None else apply_light(pixels, daylight.light))
