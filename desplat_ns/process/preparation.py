"""From what the user has to copies of photos, and of masks, in the work folder.

Masks keep features off what is in most photos: a watermark, a dashboard, a selfie stick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np

from desplat_ns.console import announce, list_names, progress_with_time_left
from desplat_ns.data.images import read_mask, resize_mask, write_image
from desplat_ns.data.photo_files import photo_names
from desplat_ns.errors import CaptureError
from desplat_ns.process.photos import Photo, prepare_photos
from desplat_ns.process.request import MIN_PHOTOS, Request
from desplat_ns.process.sources import Sources
from desplat_ns.process.workspace import Workspace


def usable_photos(folder: Workspace, request: Request, sources: Sources) -> list[Photo]:
    """Copy the photos, or the frames of a video, and say which cannot be used.

    Raises:
        CaptureError: fewer than `MIN_PHOTOS` are left, or the video's camera stands still.
        OSError: nothing can be written.
    """
    source, names = sources.folder, list(sources.names)
    if sources.is_video:
        source, names = folder.work / "frames", _frames(folder, request, sources)
    records = folder.stage("photos", lambda: _copy(folder, request, source, names))
    photos = [Photo(**photo) for photo in records]
    good = [photo for photo in photos if not photo.problem]
    problems = [f"{photo.source} ({photo.problem})" for photo in photos if photo.problem]
    if len(good) < MIN_PHOTOS:
        if "findings" not in folder.stages:  # a capture that is made stays
            folder.discard()
        raise CaptureError(
            f"{len(good)} of {len(photos)} photos can be used; at least {MIN_PHOTOS} are needed. "
            f"Not used: {list_names(problems, 5)}."
        )
    if problems:
        unused = f"{len(problems)} of {len(photos)} photos are not used"
        announce(f"{unused}: {list_names(problems)}.", warning=True)
    return good


def masks_of(folder: Workspace, request: Request, photos: Sequence[Photo]) -> Path | None:
    """Folder of the masks as the worker reads them; None without any.

    Raises:
        CaptureError: they do not belong to the photos.
    """
    mask = request.mask
    if mask is None:
        return None
    copies = folder.work / "masks"
    count = folder.stage("masks", lambda: prepare_masks(mask, photos, copies))
    if count < len(photos):
        announce(f"{len(photos) - count} of {len(photos)} photos have no mask in {mask}.", True)
    return copies


def prepare_masks(mask: Path, photos: Sequence[Photo], copies: Path) -> int:
    """Write `copies`/COPY.png for each photo that has a mask: black where no feature may be.

    Args:
        mask: a picture for all photos, or a folder with one for each, named as the photo, with any
            ending (`a.png` or `a.jpg.png` for `a.jpg`).

    Returns:
        How many photos have one.

    Raises:
        CaptureError: none has one, or one has another shape than its photo, or cannot be read.
    """
    paths = dict.fromkeys(photos, mask) if mask.is_file() else _masks_in(mask, photos)
    if not paths:
        raise CaptureError(
            f"No mask in {mask} belongs to a photo (it has {list_names(photo_names(mask), 5)}). "
            f"Needed are files named as the photos: {Path(photos[0].source).stem}.png for "
            f"{photos[0].source}; or name one picture that is the mask of all."
        )
    copies.mkdir(parents=True, exist_ok=True)
    for photo, path in paths.items():
        write_image(copies / f"{photo.copy}.png", _of_size(read_mask(path), photo, path))
    return len(paths)


def _masks_in(folder: Path, photos: Sequence[Photo]) -> dict[Photo, Path]:
    """The mask of each photo that has one: names are the same without endings, in lower case."""
    masks = {_stem(name): folder / name for name in photo_names(folder)}
    named = ((photo, masks.get(photo.source.lower())) for photo in photos)
    matched = ((photo, path or masks.get(_stem(photo.source))) for photo, path in named)
    return {photo: path for photo, path in matched if path is not None}


def _stem(name: str) -> str:
    return str(PurePosixPath(name).with_suffix("")).lower()


def _of_size(mask: np.ndarray, photo: Photo, path: Path) -> np.ndarray:
    height, width = mask.shape
    if abs(width / height - photo.width / photo.height) > 0.02 * width / height:
        raise CaptureError(
            f"Mask {path} has {width}x{height} pixels, {photo.source} is of another shape "
            f"({photo.width}x{photo.height} as used). Make it of the photo's size."
        )
    if width < photo.width:
        size = photo.width, photo.height
        return cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    return resize_mask(mask, photo.width, photo.height)


def _frames(folder: Workspace, request: Request, sources: Sources) -> list[str]:
    from desplat_ns.process.video import take_frames  # an extra

    video = sources.folder / sources.names[0]
    with progress_with_time_left("Video") as show:
        return folder.stage(
            "frames", lambda: take_frames(video, folder.work / "frames", request.frames, show)
        )


def _copy(
    folder: Workspace, request: Request, source: Path, names: Sequence[str]
) -> list[dict[str, Any]]:
    with progress_with_time_left("Photos") as show:
        photos = prepare_photos(
            source,
            names,
            folder.work / "photos",
            request.longest_side,
            request.num_threads,
            lambda done: show(done, len(names)),
        )
    return [asdict(photo) for photo in photos]
