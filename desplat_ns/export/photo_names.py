"""What photos are called in their folder, and what others expect their masks to be called."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Literal

from desplat_ns.console import list_names
from desplat_ns.errors import ConfigError

Naming = Literal["colmap", "nerfstudio"]
"""colmap: photo.jpg.png. nerfstudio: photo.png, in place of the photo's own ending."""


def original_of(path: Path, folder: Path) -> Path:
    """The photo in its full size: the one in `folder` where `path` is a copy in a folder beside it
    (images_2 for images), if it is there; else `path`."""
    if path.is_relative_to(folder.parent):
        beside, *rest = path.relative_to(folder.parent).parts
        original = folder.joinpath(*rest)
        is_copy = re.fullmatch(re.escape(folder.name) + r"_\d+", beside) is not None
        if rest and is_copy and original.is_file():
            return original
    return path


def mask_names(photos: Sequence[str], naming: Naming) -> list[str]:
    """Names of the masks of photos, as paths below the masks' folder.

    Args:
        photos: as paths below the photos' folder.

    Raises:
        ConfigError: two photos would have the same mask.
    """
    if naming == "colmap":
        return [f"{photo}.png" for photo in photos]
    names = [str(PurePosixPath(photo).with_suffix(".png")) for photo in photos]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ConfigError(
            f"--names {naming} calls the masks of several photos the same: {list_names(twice)}. "
            "Add `--names colmap`, which keeps the photos' endings."
        )
    return names
