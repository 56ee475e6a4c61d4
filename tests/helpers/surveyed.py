"""Captures with some of their photos, or with copies to be damaged, and what a survey finds."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.data.reconstruction import TRACKS


def points_of(capture: DataparserOutputs) -> np.ndarray:
    """Of the reconstruction: [N, 3]."""
    return capture.metadata["points3D_xyz"].double().numpy()


def with_points(capture: DataparserOutputs, xyz: np.ndarray, **changes: Any) -> DataparserOutputs:
    """The same capture with other points, and with other tracks where `tracks` is given."""
    tracks = changes.get("tracks", capture.metadata[TRACKS])
    metadata = {**capture.metadata, "points3D_xyz": torch.from_numpy(xyz), TRACKS: tracks}
    return replace(capture, metadata=metadata)


def copied(capture: DataparserOutputs, folder: Path) -> DataparserOutputs:
    """The same capture with photos of its own, to be damaged."""
    photos = [Path(shutil.copy(path, folder / path.name)) for path in capture.image_filenames]
    return replace(capture, image_filenames=photos)


def some(capture: DataparserOutputs, which: list[int]) -> DataparserOutputs:
    tracks = capture.metadata[TRACKS]
    fewer = replace(tracks, image_ids=tuple(tracks.image_ids[i] for i in which))
    return replace(
        capture,
        cameras=capture.cameras[torch.tensor(which, dtype=torch.long)],
        image_filenames=[capture.image_filenames[i] for i in which],
        metadata={**capture.metadata, TRACKS: fewer},
    )
