"""What a call of `desplat-process` asks for, and which photos it names. Imported at once."""

import os
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

import tyro

from desplat_ns.core.console import announce, list_names, text_of
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.options import check_ranges, ranged
from desplat_ns.data.photo_files import begin_folder, file_names, is_photo, photo_names

Cameras = Literal["auto", "one", "folder", "photo"]
CameraModel = Literal["auto", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"]
MIN_PHOTOS = 3
"""Two photos can be posed, but there would be none to hold out."""
ORIGINALS = Path("originals")
"""In the capture: COLMAP's model of the photos as they were given, before undistortion."""
MASKS = re.compile(r"(?<![a-z])masks?(?![a-z])", re.IGNORECASE)
"""In what folders of masks are called."""


@dataclass(frozen=True)
class Request:
    """Find out where photos were taken and write a capture that ns-train reads.

    With pycolmap alone. Stopped or killed, the same command goes on where it was.
    """

    photos: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PHOTOS")]
    """Folder of photos, with or without folders in it, or a video."""
    output: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="OUTPUT")]
    """Folder for the capture: images/, sparse/0 and a picture of it from above."""
    longest_side: int = ranged(1600, "[100, inf)")
    """Pixels; larger photos are reduced to it. Smaller ones than 100 have hardly any features."""
    cameras: Cameras = "auto"
    """Which photos share focal length and distortion. auto: what EXIF and size say; one: all of one
    size; folder: those of one folder and size; photo: none."""
    camera_model: CameraModel = "auto"
    """COLMAP's name. auto: up to two terms of radial distortion, by the number of photos."""
    effort: Literal["auto", "plain", "thorough"] = "auto"
    """auto: plain, and where that leaves photos out thorough, which takes several times as long."""
    mask: Path | None = None
    """Folder with a mask for each photo, or one picture for all: no features where it is black."""
    frames: int = ranged(150, "[3, inf)")
    """Of a video, at most: the sharpest, at even distances."""
    keep_work: bool = False
    """Keep features, matches and all models, in OUTPUT/work."""

    def main(self) -> None:
        """Check what can be checked at once, then make the capture; raises as `process.process`."""
        check_ranges(self)
        if self.mask is not None and not self.mask.exists():
            raise ConfigError(f"--mask is {self.mask}, which does not exist.")
        names = [] if self.is_video else find_photos(self.photos, self.output, self.mask)
        os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # read as pycolmap is imported

        from desplat_ns.tools.process.process import process  # a second: not before the checks

        process(self, names)

    @property
    def is_video(self) -> bool:
        """Whether PHOTOS is a file."""
        return self.photos.is_file()


def find_photos(photos: Path, output: Path, mask: Path | None = None) -> list[str]:
    """The photos in a folder and below, sorted, without `output`, `mask` and masks, which are told.
    Raises CaptureError where they are fewer than `MIN_PHOTOS`."""
    if not photos.is_dir():
        raise CaptureError(f"There is no '{photos}'. Name a folder of photos, or a video.")
    out, mask = output.resolve(), mask and mask.resolve()
    if photos.resolve().is_relative_to(out):
        raise CaptureError(
            f"The photos lie in the folder for the capture, {output}. Name a new folder beside it."
        )
    files = [
        name
        for name in file_names(photos)
        if not any(part.startswith(".") for part in name.split("/"))
        and not {out, mask}.intersection([at := (photos / name).resolve(), *at.parents])
    ]
    names = [name for name in files if is_photo(Path(name))]
    beside = [f"../masks/{name}" for name in photo_names(photos / "../masks")]
    masks = masks_among([*names, *beside])
    names, files = ([name for name in some if name not in masks] for some in (names, files))
    if masks and mask is None:
        folder = photos / Path(masks[0]).parent
        announce(
            f"Masks of photos are in {folder}, as their names say, and are not used. To keep "
            f"features off what is black in them: --mask {shlex.quote(str(folder))}."
        )
    if broken := [t for name in names if (t := text_of(name)) != name or min(name) < " "]:
        raise CaptureError(
            f"{len(broken)} names in {photos} are no plain text: {list_names(broken, 5)}. Rename "
            "these files."
        )
    if len(names) >= MIN_PHOTOS:
        begin_folder(photos, files)
        return names
    raise CaptureError(
        f"{photos} has {len(names)} photos among its {len(files)} files "
        f"({list_names(names or files, 5)}). At least {MIN_PHOTOS} are needed, better 20 and more, "
        "from many places. A video is named by itself."
    )


def masks_among(names: Sequence[str]) -> list[str]:
    """Pictures in folders called masks, such as `masks/a.png` or `masks/a.jpg.png` for `a.jpg`."""
    paths = [PurePosixPath(name) for name in names]
    called = [path for path in paths if MASKS.search(str(path.parent))]
    others = {key for path in {*paths} - {*called} for key in (path.name, path.stem)}
    return [str(path) for path in called if path.stem in others]
