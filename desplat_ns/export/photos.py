"""The training photos as they lie on disk: their names, those of their masks, their full size,
their cameras.

Letters in shapes: H x W pixels.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.console import list_names
from desplat_ns.data.colmap import DeSplatColmapDataParser
from desplat_ns.data.images import image_size
from desplat_ns.data.training_views import image_names
from desplat_ns.datamanager import DeSplatDataManager
from desplat_ns.errors import ConfigError
from desplat_ns.export.formats import Naming


@dataclass(frozen=True)
class Photo:
    """A training photo before it was reduced or undistorted for training."""

    index: int
    """Which training view it is."""
    name: str
    """Its path below the folder of the photos, with forward slashes."""
    camera: Cameras
    """[1], at the photo's full size, with its distortion."""


def training_photos(manager: DeSplatDataManager) -> Iterator[Photo]:
    """All training photos in the order of their views.

    Raises:
        CaptureError: a photo that cannot be read any more.
    """
    outputs = manager.train_dataparser_outputs
    folder = _folder(manager)
    originals = [original_of(path.absolute(), folder) for path in outputs.image_filenames]
    below = all(path.is_relative_to(folder) for path in originals)
    names = (
        [path.relative_to(folder).as_posix() for path in originals]
        if below
        else image_names(originals)
    )
    for index, (path, name) in enumerate(zip(originals, names, strict=True)):
        camera = outputs.cameras[index : index + 1]
        yield Photo(index, name, _at_size(camera, *image_size(path)))


def _folder(manager: DeSplatDataManager) -> Path:
    """Where COLMAP's names of the photos begin; `images` for captures without COLMAP."""
    parser = manager.dataparser
    data = Path(parser.config.data).absolute()
    if isinstance(parser, DeSplatColmapDataParser):
        return data / parser.images_path
    return (data.parent if data.suffix == ".json" else data) / "images"


def _at_size(camera: Cameras, width: int, height: int) -> Cameras:
    """The same camera [1] with more pixels."""
    x_ratio = width / float(camera.width)
    y_ratio = height / float(camera.height)
    return Cameras(
        camera_to_worlds=camera.camera_to_worlds,
        fx=camera.fx * x_ratio,
        fy=camera.fy * y_ratio,
        cx=camera.cx * x_ratio,
        cy=camera.cy * y_ratio,
        width=torch.full_like(camera.width, width),
        height=torch.full_like(camera.height, height),
        distortion_params=camera.distortion_params,
        camera_type=camera.camera_type,
    )


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
