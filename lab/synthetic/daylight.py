"""Day and weather in which a photo was taken: its light and its sky, drawn photo by photo."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from lab.synthetic.cameras import PinholeCamera
from lab.synthetic.render import AMBIENT, DIRECT, SUN, Samples, Sun, to_pixels, to_uint8
from lab.synthetic.textures import Color, f32

TINT_SPREAD = 0.04
"""Each channel of a photo's tint differs from its kind's by up to this fraction."""

SKY_SPREAD, HAZE = 0.08, 0.3
"""Each channel of a photo's sky is darker than its kind's by up to the first fraction, and its
zenith lies up to the second on the way to the horizon's colour."""

CLOUDED, CLOUD = 1 / 3, (0.25, 1.25)
"""Share of the photos with a sun of their own in which a cloud is before it, and its factors on the
sun's light and on the light from the sky."""


@dataclass(frozen=True)
class Light:
    """What `apply_light` does to a photo; the default changes nothing. All values are above 0."""

    gain: float = 1.0
    """Exposure: factor on all channels."""
    tint: Color = (1.0, 1.0, 1.0)
    """White balance: factor on each channel."""
    gamma: float = 1.0
    """Contrast: above 1 darkens the shadows more than the lights, below 1 lifts them."""

    def scaled(self, strength: float) -> "Light":
        """The way from no change (strength 0) to this light (1), in equal ratios."""
        r, g, b = (channel**strength for channel in self.tint)
        return Light(self.gain**strength, (r, g, b), self.gamma**strength)


def apply_light(rgb: Float[np.ndarray, "H W 3"], light: Light) -> Float[np.ndarray, "H W 3"]:
    """`photo = clip(gain * tint * rgb ** gamma, 0, 1)`, channel by channel.

    `rgb` in [0, 1] is the photo under canonical light. Gain and tint are an affine toning of each
    channel; gamma is not, so a model with one affine toning per photo cannot fit it exactly.
    """
    factor = f32(light.tint) * np.float32(light.gain)
    return np.clip(factor * rgb ** np.float32(light.gamma), 0, 1)


@dataclass(frozen=True)
class Sky:
    """Colours of one photo's sky under canonical light, in [0, 1]; a function of the direction."""

    horizon: Color
    zenith: Color
    glow: Color
    """Added to the horizon's colour on the brighter side of the sky."""
    azimuth: float = 0.0
    """Radians from the x axis to the middle of the brighter side, about the vertical."""

    def toward(self, directions: Float[np.ndarray, "3 *R"]) -> Float[np.ndarray, "3 *R"]:
        """Colours in world directions of any length.

        For a unit direction d with height z, and the horizontal unit vector b to the brighter side:
        `horizon + (zenith - horizon) z (2 - z) + glow ((1 + b.d) / 2)^2`: a polynomial of degree
        2, so spherical harmonics of degree 2 represent it exactly. Below the horizon (z < 0) the
        second term is left out.
        """
        x, y, z = directions / np.sqrt((directions * directions).sum(axis=0))
        rise = np.maximum(z, 0) * (2 - z)
        along = x * np.float32(np.cos(self.azimuth)) + y * np.float32(np.sin(self.azimuth))
        side = ((1 + along) / 2) ** 2
        horizon, zenith, glow = (
            f32(color).reshape(3, *[1] * z.ndim) for color in (self.horizon, self.zenith, self.glow)
        )
        return horizon + (zenith - horizon) * rise + glow * side


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
"""As many photos are of each."""


@dataclass(frozen=True)
class Daylight:
    """What one photo was taken in."""

    light: Light
    sky: Sky | None
    """None: the sky of a scene without daylight, under this light."""
    sun: Sun | None = None
    """None: the sun of a scene without daylight."""


@dataclass(frozen=True)
class DaylightSpec:
    """Which daylight the photos are taken in, and how much of it shows."""

    strength: float = 1.0
    """Of the light, from 0 (the same in all photos) to 1. The sky does not depend on it."""
    sky: bool = True
    """Whether every photo has a sky of its own."""
    sun: float = 0.0
    """Degrees to either side by which photos differ in where the sun stands, up to 180; a third of
    them has clouds before it. Shadows move and change then: no factor on a photo's colours undoes
    that."""
    plain_sky: Color | None = None
    """A sky of this one colour in all photos, whatever `sky` is, before each photo's light."""


def draw_daylights(spec: DaylightSpec, count: int, rng: np.random.Generator) -> list[Daylight]:
    """The daylight of `count` photos: every kind equally often, in random order."""
    order, kinds = rng.permutation(np.arange(count) % len(KINDS)), list(KINDS.values())
    return [_draw_daylight(spec, kinds[index], rng) for index in order]


def _draw_daylight(spec: DaylightSpec, kind: DaylightKind, rng: np.random.Generator) -> Daylight:
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
    return Daylight(light.scaled(spec.strength), shown, sun)


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
