"""Which files are to be processed: photos of a folder, or one video."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from desplat_ns.console import list_names, text_of
from desplat_ns.data.photo_files import PHOTO_SUFFIXES
from desplat_ns.errors import CaptureError
from desplat_ns.process.request import MIN_PHOTOS

RAW_SUFFIXES = frozenset(
    (".arw", ".cr2", ".cr3", ".dng", ".nef", ".orf", ".pef", ".raf", ".rw2", ".srw")
)
"""Endings of camera raw files; OpenImageIO reads them where it was built with LibRaw."""
OTHER_SUFFIXES = frozenset((".avif", ".jpe", ".jp2", ".ppm", ".pgm", ".tga"))
VIDEO_SUFFIXES = frozenset(
    (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".3gp", ".insv")
)


@dataclass(frozen=True)
class Sources:
    """What lies at PHOTOS."""

    folder: Path
    """In which the names are."""
    names: tuple[str, ...]
    """Photos as paths below the folder, sorted, or one video."""
    is_video: bool

    def fingerprint(self) -> dict[str, int]:
        """Bytes of each file: another number, and it is not the same file any more."""
        return {name: (self.folder / name).stat().st_size for name in self.names}


def find_sources(photos: Path, output: Path) -> Sources:
    """The photos of a folder and the folders in it, or a video file.

    What lies in `output` is not counted. A raw file beside a photo of the same name is that photo.

    Raises:
        CaptureError: nothing there, no photo, one or two photos, several videos.
    """
    if photos.is_file():
        if photos.suffix.lower() in VIDEO_SUFFIXES:
            return Sources(photos.parent, (photos.name,), is_video=True)
        raise CaptureError(
            f"{photos} is neither a folder of photos nor a video "
            f"({', '.join(sorted(VIDEO_SUFFIXES))}). Name the folder that holds the photos."
        )
    if not photos.is_dir():
        raise CaptureError(f"There is no folder or video {photos}. Check the first path.")
    if photos.resolve().is_relative_to(output.resolve()):
        raise CaptureError(
            f"The photos lie in the folder for the capture, {output}. Nothing is mixed with them: "
            "name a new folder beside them."
        )
    files = [
        path.relative_to(photos).as_posix()
        for path in photos.rglob("*")
        if path.is_file() and not path.resolve().is_relative_to(output.resolve())
    ]
    files = [name for name in files if not any(part[0] == "." for part in name.split("/"))]
    names = _without_raw_twins([name for name in sorted(files) if _is_source(name)])
    if broken := [text for name in names if (text := text_of(name)) != name]:
        raise CaptureError(
            f"{len(broken)} names in {photos} are no text in UTF-8 ({list_names(broken, 5)}). "
            "Rename these files."
        )
    if len(names) >= MIN_PHOTOS:
        return Sources(photos, tuple(names), is_video=False)
    videos = [name for name in files if PurePosixPath(name).suffix.lower() in VIDEO_SUFFIXES]
    raise CaptureError(_too_few(photos, names, files, videos))


def _is_source(name: str) -> bool:
    return PurePosixPath(name).suffix.lower() in PHOTO_SUFFIXES | RAW_SUFFIXES | OTHER_SUFFIXES


def _without_raw_twins(names: list[str]) -> list[str]:
    raw = {name for name in names if PurePosixPath(name).suffix.lower() in RAW_SUFFIXES}
    photos = {PurePosixPath(name).with_suffix("") for name in names if name not in raw}
    return [n for n in names if n not in raw or PurePosixPath(n).with_suffix("") not in photos]


def _too_few(photos: Path, names: list[str], files: list[str], videos: list[str]) -> str:
    if videos:
        return (
            f"{photos} has {len(names)} photos and {len(videos)} videos ({list_names(videos)}). "
            f"A video is processed by its own name: desplat-process '{photos / videos[0]}' OUTPUT."
        )
    if not files:
        return f"The folder {photos} is empty. Name one with photos, or a video."
    if not names:
        return (
            f"{photos} has no photo, but {list_names(files, 5)}. Needed are photos "
            f"({', '.join(sorted(PHOTO_SUFFIXES))}), or the name of a video."
        )
    return (
        f"{photos} has {len(names)} photo{'s' if len(names) > 1 else ''} ({list_names(names)}). "
        f"At least {MIN_PHOTOS} are needed, better 20 and more, from many places."
    )
