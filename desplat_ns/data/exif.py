"""Exposure as a photo's file gives it: often absent, sometimes wrong, so never needed."""

from __future__ import annotations

import math
from pathlib import Path

import OpenImageIO as oiio

SPEEDS = ("Exif:PhotographicSensitivity", "Exif:ISOSpeedRatings")
"""The same tag in EXIF 2.3 and before."""


def exposure_in_stops(path: Path) -> float | None:
    """log2(time x speed / 100 / aperture^2): how bright the file makes the same light, in stops.

    None where the file or a tag is missing, or a value cannot be.
    """
    file = oiio.ImageInput.open(str(path))
    if file is None:
        oiio.geterror()
        return None
    spec = file.spec()
    file.close()
    time, aperture = (_number(spec.getattribute(name)) for name in ("ExposureTime", "FNumber"))
    speed = next((n for name in SPEEDS if (n := _number(spec.getattribute(name)))), None)
    if not (time and aperture and speed):
        return None
    return math.log2(time * speed / 100 / aperture**2)


def _number(value: object) -> float | None:
    """A positive finite number, else None; lists count by their first entry."""
    if isinstance(value, (list, tuple)):
        value = value[0] if value else None
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return None
    return float(value) if math.isfinite(value) and value > 0 else None
