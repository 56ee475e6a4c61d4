"""Turns noisy maps of cells that stand out into the regions that something covers."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool
from torch import Tensor

from desplat_ns.separation.transfers import masks_to_host, to_device

MIN_AREA = 0.002
"""Share of the image: a smaller region is left to the static scene."""


def outlier_regions(
    weak: Bool[Tensor, "rows columns"], strong: Bool[Tensor, "rows columns"]
) -> Bool[Tensor, "rows columns"]:
    """Connected cells that stand out at least weakly, one of them strongly; gaps are closed and
    holes filled.

    They are found on the host: the maps go there, and the regions come back.

    Two thresholds, because the inside of an occluder is in places coloured like what it covers,
    and because noise above the lower one alone is no reason. Regions of less than `MIN_AREA` are
    dropped.

    Source: hysteresis of Canny 1986.
    """
    return to_device(_regions_of(*masks_to_host(weak, strong)), weak.device)


def _regions_of(
    weak: Bool[np.ndarray, "rows columns"], strong: Bool[np.ndarray, "rows columns"]
) -> Bool[np.ndarray, "rows columns"]:
    """`outlier_regions`, on the host."""
    count, labels = _components(weak)
    keep = np.zeros(count, bool)
    keep[labels[strong]] = True
    region = _without_holes(_closed(keep[labels] & (labels > 0)))
    count, labels = _components(region)
    areas = np.bincount(labels.ravel(), minlength=count)
    large = areas >= MIN_AREA * labels.size
    large[0] = False
    return large[labels]


def _components(mask: np.ndarray) -> tuple[int, np.ndarray]:
    """Number of labels, and labels from 1 on of cells that touch, by a side or a corner."""
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)


def _closed(mask: np.ndarray) -> np.ndarray:
    """Gaps of up to two cells closed; beyond the border it goes on as at the border."""
    padded = np.pad(mask.astype(np.uint8), 2, mode="edge")
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return closed[2:-2, 2:-2] > 0


def _without_holes(mask: np.ndarray) -> np.ndarray:
    """Filled where the outside of the image cannot be reached, by sides, through empty cells."""
    empty = np.pad(~mask, 1, constant_values=True).astype(np.uint8)
    _, labels = cv2.connectedComponents(empty, connectivity=4)
    return (labels != labels[0, 0])[1:-1, 1:-1]
