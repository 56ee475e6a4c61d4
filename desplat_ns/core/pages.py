"""What the HTML pages share: templates, pictures inside the page, figures in words.
Pictures have 8-bit colours, layers over a checkerboard; they are made as small as the page's size
asks for.

Letters in shapes: H x W pixels.
"""

import base64
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import jinja2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image

from desplat_ns.core.console import time_in_words
from desplat_ns.core.errors import ConfigError

LADDER = ((1024, 80), (800, 70), (640, 60), (480, 55), (320, 50), (160, 40))
"""Pixels of the longer side, at most, and WebP's quality: from what is best to what is smallest."""

LARGEST_SIDE = LADDER[0][0]
"""Pixels; no picture on a page is larger."""

Shown: TypeAlias = (
    UInt8[np.ndarray, "_ _ 3"]
    | Float[np.ndarray, "_ _ 3"]
    | Float[np.ndarray, "_ _ 1"]
    | Bool[np.ndarray, "_ _ 1"]
)
"""Colours, or one channel to be shown in grey; floats and booleans run from 0 to 1."""


def template(path: Path, **filters: Callable[..., Any]) -> jinja2.Template:
    """A template that escapes what it is given, with `filters` and `time`; unknown names fail."""
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"time": time_in_words, **filters}
    return environment.from_string(path.read_text("utf8"))


@dataclass(frozen=True)
class Picture:
    """A picture for the page."""

    pixels: UInt8[np.ndarray, "H W 3"]
    share: float = 1.0
    """Of the side that pictures may have: a picture that is shown smaller needs fewer pixels."""

    def address(self, side: int, quality: int) -> str:
        """A data address that holds it as WebP, at most `side` pixels long where `share` is 1."""
        buffer = io.BytesIO()
        pixels = shrunk(self.pixels, max(1, round(side * self.share)))
        Image.fromarray(pixels).save(buffer, "WEBP", quality=quality, method=2)
        return f"data:image/webp;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def picture_of(image: Any, share: float = 1.0) -> Picture:
    """A tensor or array [H, W, 1 or 3], in [0, 1] or of 8 bits, as large as a page may need it."""
    pixels = image.detach().cpu().numpy() if hasattr(image, "detach") else image
    return Picture(shrunk(to_rgb8(pixels), LARGEST_SIDE), share)


def fitted_into(pictures: Sequence[Picture], budget: int) -> list[str]:
    """The data addresses of pictures as WebP, as large and as good as a budget of bytes for all of
    them allows. Raises ConfigError where there are too many even for the smallest size."""
    for side, quality in LADDER:
        sources, size = [], 0
        for picture in pictures:
            sources.append(picture.address(side, quality))
            size += len(sources[-1])
            if size > budget:
                break
        else:
            return sources
    raise ConfigError(
        f"{len(pictures)} pictures do not fit into a page of {budget / 1e6:.3g} MB, however small "
        "they are made. Ask for fewer: --training-photos 50 --held-out-photos 12."
    )


def shrunk(pixels: UInt8[np.ndarray, "H W 3"], side: int) -> UInt8[np.ndarray, "h w 3"]:
    """A picture whose longer side has at most `side` pixels; never enlarged."""
    image = Image.fromarray(pixels)
    image.thumbnail((side, side), Image.Resampling.LANCZOS)
    return np.asarray(image)


def to_rgb8(picture: Shown) -> UInt8[np.ndarray, "H W 3"]:
    """8-bit colours; floats are clipped to [0, 1] and rounded, NaN is black."""
    values = np.asarray(picture)
    if values.dtype != np.uint8:
        scaled = np.nan_to_num(values.astype(np.float64))
        values = np.round(np.clip(scaled, 0, 1) * 255).astype(np.uint8)
        values = np.broadcast_to(values, (*values.shape[:2], 3)).copy()
    return values


def over_checkerboard(
    rgb: Float[np.ndarray, "H W 3"], alpha: Float[np.ndarray, "H W 1"], size: int = 8
) -> Float[np.ndarray, "H W 3"]:
    """A layer (colours already weighted by alpha) over pale squares of `size` pixels: black and
    white things can both be told from nothing at all."""
    rows, columns = np.indices(alpha.shape[:2]) // size
    squares = np.where((rows + columns) % 2 == 0, 0.92, 0.8)[..., None]
    return (rgb + (1 - alpha) * squares).astype(rgb.dtype)
