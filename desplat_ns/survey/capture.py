"""What the survey is given: the training photos of a capture, their cameras, points and tracks.

Letters in shapes: P points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.data.tracks import METADATA_KEY, Tracks


@dataclass(frozen=True)
class Capture:
    """One split of a capture, as it is on disk: photos are not undistorted."""

    cameras: Cameras
    photos: Sequence[Path]
    xyz: Float[np.ndarray, "P 3"]
    """Points in the cameras' world."""
    tracks: Tracks | None = None
    """None where nobody knows which photo observed which point."""
    masks: Sequence[Path] | None = None
    """Where each photo may be used, if the capture says so."""


def capture_of(source: Any) -> Capture:
    """The training photos of a data manager, a dataset or a data parser's outputs.

    The cameras are those of the files: a data manager changes its own when it undistorts photos.
    """
    outputs = getattr(source, "train_dataparser_outputs", source)
    outputs = getattr(outputs, "_dataparser_outputs", outputs)
    assert isinstance(outputs, DataparserOutputs)
    xyz = outputs.metadata.get("points3D_xyz")
    return Capture(
        cameras=outputs.cameras,
        photos=list(outputs.image_filenames),
        xyz=np.zeros((0, 3)) if xyz is None else xyz.double().cpu().numpy(),
        tracks=outputs.metadata.get(METADATA_KEY),
        masks=outputs.mask_filenames,
    )
