"""Ground-truth masks of what stands in the way: where they lie and how they are read.

Evaluation compares the model's masks with them; training never sees them.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from desplat_ns.data.images import read_grey
from desplat_ns.data.reconstruction import Frame

METADATA_KEY = "distractor_mask_filenames"
"""Where the data parser leaves the masks' paths (or None), one for each training photo."""

MASK_LEVEL = 0.5
"""Grey above which a mask's pixel counts as distractor; in a mask without any, all above black."""


def gt_masks(folder: Path, frames: Sequence[Frame]) -> dict[str, list[Path | None]]:
    """Metadata `METADATA_KEY`: the mask of each photo, None where it has none.

    Empty where no photo has one. A mask is a .png with the photo's name below `folder`, white where
    a distractor is.
    """
    paths = [folder / Path(frame.name).with_suffix(".png") for frame in frames]
    masks = [path if path.is_file() else None for path in paths]
    return {METADATA_KEY: masks} if any(masks) else {}


def read_gt_mask(path: Path, width: int, height: int) -> Bool[Tensor, "H W 1"]:
    """A mask image (white = distractor) at the given size in pixels, nearest neighbour. Raises
    CaptureError, naming the file, where it is missing or no image."""
    grey = read_grey(path)
    rows = (np.arange(height) + 0.5) * grey.shape[0] / height
    columns = (np.arange(width) + 0.5) * grey.shape[1] / width
    level = MASK_LEVEL if grey.max() > MASK_LEVEL else 0
    mask = grey[rows.astype(int)][:, columns.astype(int)] > level
    return torch.from_numpy(mask)[..., None]
