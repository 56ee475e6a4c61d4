"""Which effects a scene calls for. One that is off has no parameters and costs nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass
class EffectsConfig:
    """Switches, all in one place."""

    distractors: bool = True
    """Explain what stands in the way by a set of Gaussians for each training view. Off gives the
    plain baseline, Splatfacto's loss and schedule."""
    appearance: Literal["off", "affine", "sh"] = "off"
    """Each image has an embedding that changes the colours of the static Gaussians: affine scales
    and shifts each one's colour (Eq. 6-7), sh adds to its spherical harmonics (Splatfacto-W). For
    photos that differ in light, weather or camera."""
    background: bool = False
    """What lies behind all Gaussians depends on the direction, and with an appearance model on the
    image (Eq. 8-12). For the sky."""
