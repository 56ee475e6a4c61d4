"""The light of one photo: exposure, white balance and contrast of everything in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from desplat_ns.errors import ConfigError
from lab.synthetic.arrays import f32
from lab.synthetic.textures import Color


@dataclass(frozen=True)
class Light:
    """What `apply_light` does to a photo; the default changes nothing."""

    gain: float = 1.0
    """Exposure: factor on all channels."""
    tint: Color = (1.0, 1.0, 1.0)
    """White balance: factor on each channel."""
    gamma: float = 1.0
    """Contrast: above 1 darkens the shadows more than the lights, below 1 lifts them."""

    def __post_init__(self) -> None:
        if not min(self.gain, self.gamma, *self.tint) > 0:
            raise ConfigError(
                f"A light with gain {self.gain}, tint {self.tint} and gamma {self.gamma} leaves "
                "nothing to see. Choose all of them above 0."
            )

    def scaled(self, strength: float) -> Light:
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
