"""Photos or a video to a capture: the stages in their order, each done once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from desplat_ns.console import announce
from desplat_ns.errors import CaptureError
from desplat_ns.files.lock import only_process_in
from desplat_ns.process.attempts import Attempt, Task, best_attempt
from desplat_ns.process.cameras import group_by_camera
from desplat_ns.process.jobs import run_job
from desplat_ns.process.messages import (
    made_already,
    may_be_made_thoroughly,
    no_model,
    report_lines,
)
from desplat_ns.process.photos import Photo
from desplat_ns.process.preparation import masks_of, usable_photos
from desplat_ns.process.request import Request
from desplat_ns.process.sources import Sources
from desplat_ns.process.top_view import draw_from_above
from desplat_ns.process.workspace import Workspace, open_workspace, unwritable

OF_THE_CAPTURE = ("undistortion", "findings")
"""Stages whose results are the capture itself, not in the work folder."""


def process(request: Request, sources: Sources) -> Workspace:
    """Make the capture, or go on where an earlier call stopped; says what came out.

    Raises:
        ConfigError: the output folder holds something else, or was begun with other options, or
            another process is at work in it.
        CaptureError: too few photos can be used, or nothing ties them together.
        DeSplatError: the disk is full, or pycolmap failed. What is done is kept.
    """
    with only_process_in(request.output):
        return _process(request, sources)


def _process(request: Request, sources: Sources) -> Workspace:
    folder = open_workspace(request.output, request.lasting(), sources.fingerprint())
    if "findings" not in folder.stages or _goes_on_thoroughly(folder, request):
        try:
            _make(folder, request, sources)
        except OSError as error:
            raise unwritable(folder.output, error) from error
    else:
        announce(made_already(folder))
    for line in report_lines(folder):
        announce(line)
    if not request.keep_work:
        folder.remove_work()
    return folder


def _goes_on_thoroughly(folder: Workspace, request: Request) -> bool:
    """Whether a capture that is made from plain features is to be made from thorough ones.

    What is not in the work folder any more is struck from the record; the capture stays.
    """
    if request.effort != "thorough" or not may_be_made_thoroughly(folder):
        return False
    copies = [Photo(**photo) for photo in folder.stages.get("photos", {}).get("result", ())]
    there = (folder.work / "photos" / photo.copy for photo in copies if not photo.problem)
    whole = bool(copies) and all(path.is_file() for path in there)
    gone = ["masks"] if whole else [name for name in folder.stages if name not in OF_THE_CAPTURE]
    folder.forget(gone)
    announce(
        f"{folder.output} is made from plain features. Once more, thoroughly; it stays as it is "
        "until a better one is ready."
    )
    return True


def _make(folder: Workspace, request: Request, sources: Sources) -> None:
    earlier = folder.stages.get("findings", {}).get("result")
    if folder.stages and not earlier:
        announce(f"Going on in {folder.output}; done already: {', '.join(folder.stages)}.")
    photos = usable_photos(folder, request, sources)
    cameras = group_by_camera(photos, request.cameras, request.camera_model)
    announce(f"{len(photos)} photos, {len(cameras)} camera{'s' if len(cameras) > 1 else ''}.")
    pairing = "sequential" if sources.is_video and request.matching == "auto" else request.matching
    masks = masks_of(folder, request, photos)
    best = best_attempt(Task(folder, request, photos, cameras, masks, pairing))
    if earlier:
        if (earlier["photos"], earlier["observations"]) >= best.score():
            announce(f"That poses {best.num_posed} photos, no more: {folder.output} stays.")
            return
        folder.forget(OF_THE_CAPTURE)
    if not best.models:
        raise CaptureError(no_model(best.left_out))
    findings = _findings(best, photos)
    folder.stage("undistortion", lambda: _undistort(folder, request, photos, best))
    title = f"{findings['photos']} cameras and {findings['points']} points from above"
    draw_from_above(folder.work / "view.npz", folder.picture, title)
    folder.stage("findings", lambda: findings)


def _findings(best: Attempt, photos: Sequence[Photo]) -> dict[str, Any]:
    """What the report says."""
    model = best.models[0]
    return {
        "photos": best.num_posed,
        "of": len(photos),
        "others": [len(other["photos"]) for other in best.models[1:]],
        "points": model["points"],
        "observations": model["observations"],
        "error": model["error"],
        "recipe": best.recipe.name,
        "left_out": [asdict(photo) for photo in best.left_out],
    }


def _undistort(folder: Workspace, request: Request, photos: Sequence[Photo], best: Attempt) -> None:
    run_job(
        folder,
        "undistortion",
        "desplat_ns.process.undistortion.undistort",
        {
            "model": folder.work / best.recipe.name / "models" / best.models[0]["folder"],
            "photos": folder.work / "photos",
            "output": folder.output,
            "names": {photo.copy: photo.name for photo in photos},
            "longest_side": request.longest_side,
            "threads": request.num_threads,
        },
    )
