"""The sheet of a survey's evidence: photos, the same without their light, what that leaves, and the
sky."""

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageOps

from desplat_ns.survey.appearance import LOCAL_STEP
from desplat_ns.survey.photo_light import from_middle
from desplat_ns.survey.survey import Evidence

MOST_COLUMNS, SIDE, HEAD = 8, 200, 18
"""Photos on the sheet; pixels of the square in which each is shown, and of the row's title."""
ROWS = (
    "photos",
    "without each photo's own light",
    f"what that leaves: green less than {LOCAL_STEP:.0%}, orange lighter, blue darker",
    "blue: nothing behind",
)
SAME, LIGHTER, DARKER, SKY = (60, 190, 90), (250, 160, 40), (40, 60, 230), (40, 110, 255)


def evidence_picture(evidence: Evidence) -> Image.Image:
    """Rows as in `ROWS`; columns are photos evenly spread."""
    count = len(evidence.observations.views)
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_COLUMNS)).round().astype(int))
    sheet = Image.new("RGB", (len(chosen) * SIDE, len(ROWS) * (HEAD + SIDE)), "white")
    for number, title in enumerate(ROWS):
        ImageDraw.Draw(sheet).text((4, number * (HEAD + SIDE) + 3), title, "black")
    for column, row in enumerate(chosen.tolist()):
        for number, picture in enumerate(_pictures(evidence, row)):
            small = Image.fromarray(picture)
            small = ImageOps.pad(small, (SIDE - 6, SIDE - 6), color="white", centering=(0.5, 0))
            sheet.paste(small, (column * SIDE + 3, number * (HEAD + SIDE) + HEAD))
    return sheet


def _pictures(evidence: Evidence, row: int) -> list[UInt8[np.ndarray, "H W 3"]]:
    """One photo in all `ROWS`."""
    observations, sky, steps = evidence.observations, evidence.skies.get(row), evidence.steps[row]
    photo, size = observations.photos[row], observations.views[row].size
    places = np.stack(np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5), axis=-1)
    neutral = evidence.light.neutral(row, photo / 255.0, from_middle(size, places))
    pale, radius = (photo // 2 + 110).astype(np.uint8), max(1, round(max(size) / 160))
    for at in np.flatnonzero(np.isfinite(steps)):
        color = SAME if abs(steps[at]) <= LOCAL_STEP else LIGHTER if steps[at] > 0 else DARKER
        x, y = observations.places[row, at].astype(int).tolist()
        cv2.circle(pale, (x, y), radius, color, -1, cv2.LINE_AA)
    blue = photo
    if sky is not None:
        cells = cv2.resize(sky.cells.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        blue = np.where(cells[..., None], 0.4 * photo + 0.6 * np.array(SKY), photo)
    return [photo, np.rint(neutral.clip(0, 1) * 255).astype(np.uint8), pale, blue.astype(np.uint8)]
