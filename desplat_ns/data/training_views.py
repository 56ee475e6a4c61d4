"""Which training view is this: its number, its name; and which of many stand for all."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from nerfstudio.cameras.cameras import Cameras


def train_index(camera: Cameras) -> int | None:
    """Which training view this camera is, by `metadata["train_idx"]`, or None. nerfstudio's own
    `cam_idx`, which its viewer sends with every frame, says nothing alone; beside the other it is
    the same number, which need not be fetched from a GPU."""
    metadata = camera.metadata or {}
    index, number = metadata.get("train_idx"), metadata.get("cam_idx")
    if index is None or isinstance(number, int):
        return None if index is None else number
    return int(index.reshape(-1)[0])


def view_name(names: Sequence[str], index: int) -> str:
    """File name of a training photo, or its number where there are no names."""
    return names[index] if index < len(names) else f"number {index}"


def image_names(paths: Sequence[Path]) -> list[str]:
    """Names of image files relative to the folder that they share, with forward slashes."""
    paths = [path.absolute() for path in paths]
    folder = os.path.commonpath([path.parent for path in paths]) if paths else ""
    return [path.relative_to(folder).as_posix() for path in paths]


def even_subset(count: int, most: int) -> list[int]:
    """At most `most` of the numbers from 0 to `count` - 1, evenly spread, both ends among them."""
    return [int(i) for i in np.linspace(0, count - 1, min(count, most)).round()]
