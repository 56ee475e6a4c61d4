"""Shared by the readers of captures: lists of names, files that must exist, console lines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.console import announce_once, list_names
from desplat_ns.data.tracks import METADATA_KEY as TRACKS
from desplat_ns.errors import CaptureError

LARGEST_SIDE = 1 << 16
"""Pixels. No photo has a longer side; a camera that says so is damaged."""


def how_to_get_poses(photos: Path) -> str:
    """What to do with photos whose cameras have no poses yet, for errors."""
    return (
        f"Type `desplat-process '{photos}' CAPTURE` to find them, or run COLMAP by itself; then "
        "train with --data CAPTURE."
    )


def check_files(paths: Sequence[Path], folder: Path, what: str, option: str) -> None:
    """Make sure that all files are there.

    Raises:
        CaptureError: lists what is missing from `folder`, `what` it is, and the `option` to set.
    """
    missing = [path for path in paths if not path.is_file()]
    if not missing:
        return
    if not folder.is_dir():
        raise CaptureError(f"The {what} folder {folder} does not exist. Name it with {option}.")
    names = list_names(_below(path, folder) for path in missing)
    raise CaptureError(
        f"{len(missing)} of {len(paths)} {what} that the capture names are not in {folder}: "
        f"{names}. Put them there, or name their folder with {option}."
    )


def check_cameras(cameras: Cameras, names: Sequence[str], source: Path) -> None:
    """Make sure that poses, focal lengths and sizes are those of cameras.

    Raises:
        CaptureError: names the photos whose are not, and `source`, where they were read.
    """
    count = len(names)
    if count == 0:  # a split without photos; others say so
        return
    numbers = [cameras.camera_to_worlds, cameras.fx, cameras.fy, cameras.cx, cameras.cy]
    if cameras.distortion_params is not None:
        numbers.append(cameras.distortion_params)
    is_valid = torch.cat([n.reshape(count, -1) for n in numbers], dim=1).isfinite().all(dim=1)
    for focal in (cameras.fx, cameras.fy):
        is_valid &= focal.reshape(count) > 0
    for side in (cameras.width, cameras.height):
        is_valid &= (side.reshape(count) >= 1) & (side.reshape(count) <= LARGEST_SIDE)
    bad = [name for name, fine in zip(names, is_valid.tolist(), strict=True) if not fine]
    if bad:
        raise CaptureError(
            f"{len(bad)} of {count} photos in {source} have a pose or a camera that cannot be "
            "(NaN, infinite or too large numbers, a focal length of 0, a size without pixels): "
            f"{list_names(bad)}. Remove them, or make the reconstruction again."
        )


def without_infinite_points(metadata: dict[str, Any], source: Path) -> dict[str, Any]:
    """The metadata without points whose place is not finite; says how many were left out."""
    xyz = metadata.get("points3D_xyz")
    if xyz is None or bool(xyz.isfinite().all()):
        return metadata
    keep = xyz.isfinite().all(dim=-1)
    announce_once(
        f"{int((~keep).sum())} of {len(xyz)} points in {source} have NaN, infinite or too large "
        "coordinates and are left out.",
        warning=True,
    )
    kept: dict[str, Any] = {
        key: value[keep] if key.startswith("points3D") and isinstance(value, Tensor) else value
        for key, value in metadata.items()
    }
    if TRACKS in kept:
        kept[TRACKS] = kept[TRACKS].keep(keep.numpy())
    return kept


def _below(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)


def read_lines(file: Path) -> list[str]:
    """Lines of a text file that are not blank, without blanks around them; UTF-8, with or without
    a byte order mark.

    Raises:
        CaptureError: it cannot be read, or is in another encoding.
    """
    try:
        text = file.read_text("utf-8-sig")
    except (OSError, ValueError) as error:
        raise CaptureError(f"{file} cannot be read as UTF-8 text: {error}.") from error
    return [line.strip() for line in text.splitlines() if line.strip()]
