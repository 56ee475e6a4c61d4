"""Small masks on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

WIDTH, HEIGHT = 4, 2


def write_mask(path: Path, columns: int, scale: int = 1) -> Path:
    """A mask whose first `columns` columns are white."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[:, :columns] = 255
    Image.fromarray(mask.repeat(scale, 0).repeat(scale, 1)).save(path)
    return path
