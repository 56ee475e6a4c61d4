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
    observations = evidence.observations
    count = len(observations.views)
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_COLUMNS)).round().astype(int))
    columns = [
        [
            observations.photos[row],
            _without_light(evidence, row),
            _with_points(evidence, row),
            _with_sky(evidence, row),
        ]
        for row in chosen.tolist()
    ]
    return np.concatenate(
        [_row(title, [column[row] for column in columns]) for row, title in enumerate(ROWS)]
    )


def _row(title: str, pictures: list[np.ndarray]) -> np.ndarray:
    head = 3 * GAP
    sheet = np.full((head + SIDE + GAP, len(pictures) * (SIDE + GAP) + GAP, 3), 255, np.uint8)
    font, black = cv2.FONT_HERSHEY_SIMPLEX, (20, 20, 20)
    cv2.putText(sheet, title, (GAP, head - 5), font, 0.4, black, 1, cv2.LINE_AA)
    for column, picture in enumerate(pictures):
        height, width = picture.shape[:2]
        ratio = SIDE / max(height, width)
        size = max(1, round(width * ratio)), max(1, round(height * ratio))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        left = GAP + column * (SIDE + GAP) + (SIDE - size[0]) // 2
        sheet[head : head + size[1], left : left + size[0]] = small
    return sheet


def _without_light(evidence: Evidence, row: int) -> np.ndarray:
    photo = evidence.observations.photos[row]
    height, width = photo.shape[:2]
    places = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    neutral = evidence.light.neutral(row, photo / 255.0, from_middle((width, height), places))
    return np.rint(neutral.clip(0, 1) * 255).astype(np.uint8)


def _with_points(evidence: Evidence, row: int) -> np.ndarray:
    steps, photo = evidence.steps[row], evidence.observations.photos[row]
    pale = (photo // 2 + 110).astype(np.uint8)
    radius = max(1, round(max(photo.shape[:2]) / 160))
    for which, color in (
        (np.abs(steps) <= LOCAL_STEP, SAME),
        (steps > LOCAL_STEP, LIGHTER),
        (steps < -LOCAL_STEP, DARKER),
    ):
        for x, y in evidence.observations.places[row, which]:
            cv2.circle(pale, (int(x), int(y)), radius, color, -1, cv2.LINE_AA)
    return pale


def _with_sky(evidence: Evidence, row: int) -> np.ndarray:
    photo, sky = evidence.observations.photos[row], evidence.skies.get(row)
    if sky is None:
        return photo
    size = photo.shape[1], photo.shape[0]
    cells = cv2.resize(sky.cells.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    mixed = (0.4 * photo + 0.6 * SKY).astype(np.uint8)
    return np.where(cells[..., None], mixed, photo)
