"""The lens as a file gives it: often absent, sometimes wrong, so never needed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import OpenImageIO as oiio

from desplat_ns.data.heic import heic_tags, is_heic
from desplat_ns.errors import CaptureError


@dataclass(frozen=True)
class Lens:
    """What a photo was taken with."""

    name: str
    """Make, model, lens and focal length in millimetres; empty where the file says nothing."""
    focal_35mm: float
    """Millimetres, as on 35 mm film; 0 where the file does not say."""


def lens_of(path: Path) -> Lens:
    """What the file says about camera and lens; nothing where it is missing or is no photo."""
    find = _tags_of(path)
    tags = ("Make", "Model", "Exif:LensModel", "Exif:FocalLength")
    values = [str(value).strip() for tag in tags if (value := find(tag))]
    return Lens(" ".join(values), _number(find("Exif:FocalLengthIn35mmFilm")) or 0.0)


def _tags_of(path: Path) -> Callable[[str], object]:
    """Gives a tag of a file by OpenImageIO's name for it; None for what is not there."""
    if is_heic(path):
        try:
            return heic_tags(path).get
        except CaptureError:
            return lambda tag: None
    file = oiio.ImageInput.open(str(path))
    if file is None:
        oiio.geterror()
        return lambda tag: None
    spec = file.spec()
    file.close()
    return spec.getattribute  # type: ignore[no-any-return]


def _number(value: object) -> float | None:
    """A positive finite number, else None; lists count by their first entry."""
    if isinstance(value, (list, tuple)):
        value = value[0] if value else None
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return None
    return float(value) if math.isfinite(value) and value > 0 else None
