"""A labelled sheet of pictures: one row for each view, one column for each kind of picture."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from desplat_ns.core.pages import Shown, to_rgb8

GAP, BAR = 6, 24
"""Pixels between pictures; height of a line of text."""

PAPER, INK = (250, 250, 248), (30, 30, 30)
"""8-bit colours of the sheet and of its text."""


def sheet(
    rows: Sequence[tuple[str, Sequence[Shown]]], titles: Sequence[str], heading: str = ""
) -> UInt8[np.ndarray, "H W 3"]:
    """Pictures in a grid: a label above each row, a title above each column, `heading` on top.

    All pictures get the size of the first one (nearest neighbour). Raises ValueError where a row
    does not hold one picture for each title, or there are no rows.
    """
    if not rows or any(len(pictures) != len(titles) for _, pictures in rows):
        raise ValueError(
            f"Rows of {[len(pictures) for _, pictures in rows]} pictures do not fit "
            f"{len(titles)} titles: give each row one picture for each title."
        )
    height, width = np.asarray(rows[0][1][0]).shape[:2]
    top = GAP + BAR * (1 + bool(heading))
    canvas = Image.new(
        "RGB",
        (GAP + len(titles) * (width + GAP), top + len(rows) * (BAR + height)),
        PAPER,
    )
    draw = ImageDraw.Draw(canvas)
    _write(draw, heading, (GAP, GAP), canvas.width, size=16)
    for column, title in enumerate(titles):
        _write(draw, title, (GAP + column * (width + GAP), top - BAR), width, size=15)
    for row, (label, pictures) in enumerate(rows):
        y = top + row * (BAR + height)
        for column, picture in enumerate(pictures):
            tile = Image.fromarray(to_rgb8(picture))
            tile = tile.resize((width, height), Image.Resampling.NEAREST)
            canvas.paste(tile, (GAP + column * (width + GAP), y))
        _write(draw, label, (GAP, y + height + 3), canvas.width, size=12)
    return np.asarray(canvas)


def _write(
    draw: ImageDraw.ImageDraw, text: str, position: tuple[int, int], width: int, size: int
) -> None:
    """Text, cut off with an ellipsis where it is longer than `width` pixels."""
    font = ImageFont.load_default(size)
    if draw.textlength(text, font) > width:
        while text and draw.textlength(text + "…", font) > width:
            text = text[:-1]
        text += "…"
    draw.text(position, text, fill=INK, font=font)
