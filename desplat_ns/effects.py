"""Which effects a scene calls for. One that is off has no parameters and costs nothing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class EffectsConfig:
    """Switches, all in one place."""

    distractors: bool = True
    """Explain what stands in the way by a set of Gaussians for each training view. Off gives the
    plain baseline, Splatfacto's loss and schedule."""
