"""A sheet of the evidence: photos, the same without their light, what that leaves, the sky."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

from desplat_ns.survey.appearance import LOCAL_STEP
from desplat_ns.survey.photo_light import from_middle
from desplat_ns.survey.survey import Evidence

MOST_COLUMNS = 8
SIDE, GAP = 200, 6
"""Pixels: the square in which a photo is shown, and between two of them."""
ROWS = (
    "photos",
    "without each photo's own light",
    f"what that leaves: green less than {LOCAL_STEP:.0%}, orange lighter, blue darker",
    "blue: nothing behind",
)
SAME, LIGHTER, DARKER = (60, 190, 90), (250, 160, 40), (40, 60, 230)
SKY = np.array([40, 110, 255])


def evidence_picture(evidence: Evidence) -> UInt8[np.ndarray, "H W 3"]:
    """Rows as in `ROWS`; columns are photos evenly spread."""
    count, head = len(evidence.observations.views), 3 * GAP
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_COLUMNS)).round().astype(int))
    height, width = head + SIDE + GAP, len(chosen) * (SIDE + GAP) + GAP
    sheet = np.full((len(ROWS) * height, width, 3), 255, np.uint8)
    for number, title in enumerate(ROWS):
        font, black, at = cv2.FONT_HERSHEY_SIMPLEX, (20, 20, 20), (GAP, number * height + head - 5)
        cv2.putText(sheet, title, at, font, 0.4, black, 1, cv2.LINE_AA)
    for column, row in enumerate(chosen.tolist()):
        for number, picture in enumerate(_pictures(evidence, row)):
            ratio = SIDE / max(picture.shape[:2])
            size = tuple(max(1, round(side * ratio)) for side in picture.shape[1::-1])
            small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            left = GAP + column * (SIDE + GAP) + (SIDE - size[0]) // 2
            top = number * height + head
            sheet[top : top + size[1], left : left + size[0]] = small
    return sheet


def _pictures(evidence: Evidence, row: int) -> list[np.ndarray]:
    """One photo in all `ROWS`."""
    observations, sky, steps = evidence.observations, evidence.skies.get(row), evidence.steps[row]
    photo, size = observations.photos[row], observations.views[row].size
    places = np.stack(np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5), axis=-1)
    neutral = evidence.light.neutral(row, photo / 255.0, from_middle(size, places))
    pale, radius = (photo // 2 + 110).astype(np.uint8), max(1, round(max(size) / 160))
    for which, color in (
        (np.abs(steps) <= LOCAL_STEP, SAME),
        (steps > LOCAL_STEP, LIGHTER),
        (steps < -LOCAL_STEP, DARKER),
    ):
        for x, y in observations.places[row, which]:
            cv2.circle(pale, (int(x), int(y)), radius, color, -1, cv2.LINE_AA)
    blue = photo
    if sky is not None:
        cells = cv2.resize(sky.cells.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        blue = np.where(cells[..., None], (0.4 * photo + 0.6 * SKY).astype(np.uint8), photo)
    return [photo, np.rint(neutral.clip(0, 1) * 255).astype(np.uint8), pale, blue]
