"""From what the user has to copies of photos, and of masks, in the work folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from desplat_ns.console import announce, list_names, progress_with_time_left
from desplat_ns.errors import CaptureError
from desplat_ns.process.masks import prepare_masks
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
    told = folder.stage("photos", lambda: _copy(folder, request, source, names))
    photos = [Photo(**photo) for photo in told]
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
