"""Ground-truth masks of what stands in the way: where they lie and how they are read.

Evaluation compares the model's masks with them; training never sees them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool
from PIL import Image
from torch import Tensor

from desplat_ns.data.images import read_image
from desplat_ns.data.reconstruction import Frame

METADATA_KEY = "distractor_mask_filenames"
"""Where the data parser leaves the masks' paths (or None), one for each training photo."""

MASK_LEVEL = 127
"""8-bit grey above which a mask's pixel counts as distractor."""


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
    grey = Image.fromarray(read_image(path)[..., :3]).convert("L")
    mask = np.asarray(grey.resize((width, height), Image.Resampling.NEAREST)) > MASK_LEVEL
    return torch.from_numpy(mask)[..., None]
