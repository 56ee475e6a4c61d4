"""What a call of `desplat-process` asks for. Imports nothing that takes time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from desplat_ns.cores import cores
from desplat_ns.errors import ConfigError

Cameras = Literal["auto", "one", "folder", "photo"]
CameraModel = Literal["auto", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"]
Matching = Literal["auto", "exhaustive", "sequential", "similar"]
Effort = Literal["auto", "plain", "thorough"]

SMALLEST_SIDE = 100
"""Pixels. Smaller photos have hardly any features."""
MIN_PHOTOS = 3
"""Two photos can be posed, but there would be none to hold out."""


@dataclass(frozen=True)
class Request:
    """Find out where photos were taken and write a capture that ns-train reads.

    With pycolmap alone. Stopped or killed, the same command goes on where it was.
    """

    photos: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PHOTOS")]
    """Folder of photos, with or without folders in it, or a video."""
    output: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="OUTPUT")]
    """Folder for the capture: images/, sparse/0 and a picture of it from above."""
    longest_side: int = 1600
    """Pixels; larger photos are reduced to it."""
    cameras: Cameras = "auto"
    """Which photos share focal length and distortion. auto: what EXIF and size say; one: all of one
    size; folder: those of one folder and size; photo: none."""
    camera_model: CameraModel = "auto"
    """COLMAP's name. auto: up to two terms of radial distortion, by the number of photos."""
    matching: Matching = "auto"
    """Which pairs are compared. auto: all up to 200 photos, above those that look alike; of a video
    neighbours and what looks alike."""
    effort: Effort = "auto"
    """auto: plain, and where that leaves photos out thorough, which takes several times as long.
    thorough takes up a capture that plain has finished."""
    mask: Path | None = None
    """Folder with a mask for each photo, or one picture for all: no features where it is black."""
    frames: int = 150
    """Of a video, at most: the sharpest, at even distances."""
    threads: int = 0
    """0: all cores."""
    keep_work: bool = False
    """Keep features, matches and all models, in OUTPUT/work."""

    def check(self) -> None:
        """Make sure that numbers are in their range.

        Raises:
            ConfigError: lists all that are not.
        """
        wrong = [
            f"--{name.replace('_', '-')} is {value}; give {least} or more"
            for name, value, least in (
                ("longest_side", self.longest_side, SMALLEST_SIDE),
                ("frames", self.frames, MIN_PHOTOS),
                ("threads", self.threads, 0),
            )
            if value < least
        ]
        if self.mask is not None and not self.mask.exists():
            wrong.append(
                f"--mask is {self.mask}, which does not exist; give a folder with one mask for "
                "each photo, or one picture for all"
            )
        if wrong:
            raise ConfigError(". ".join(wrong) + ".")

    @property
    def num_threads(self) -> int:
        """Threads that are used: what was asked for, or all cores."""
        return self.threads or cores()

    def lasting(self) -> dict[str, str]:
        """The options that a second call must share with the first, by their names."""
        names = ("longest_side", "cameras", "camera_model", "matching", "mask", "frames")
        asked = {"photos": str(self.photos.resolve())}
        return asked | {name: str(getattr(self, name)) for name in names}
