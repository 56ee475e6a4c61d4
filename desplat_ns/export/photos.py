"""The training photos as they lie on disk: their names, their full size, their cameras.

Letters in shapes: H x W pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.data.colmap import DeSplatColmapDataParser
from desplat_ns.data.images import image_size
from desplat_ns.data.training_views import image_names
from desplat_ns.datamanager import DeSplatDataManager
from desplat_ns.export.photo_names import original_of


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
