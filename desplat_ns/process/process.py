"""Photos or a video to a capture: the stages in their order, each done once, and the report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from desplat_ns.console import announce, list_names
from desplat_ns.errors import CaptureError
from desplat_ns.files.whole import only_process_in
from desplat_ns.process.attempts import Attempt, Task, best_attempt
from desplat_ns.process.cameras import group_by_camera
from desplat_ns.process.jobs import run_job
from desplat_ns.process.photos import Photo
from desplat_ns.process.preparation import masks_of, usable_photos
from desplat_ns.process.recipes import PLAIN, THOROUGH
from desplat_ns.process.request import Request
from desplat_ns.process.sources import Sources
from desplat_ns.process.workspace import Workspace, open_workspace, unwritable

OF_THE_CAPTURE = ("undistortion", "findings")
"""Stages whose results are the capture itself, not in the work folder."""
LISTED = 20
"""Reasons that are told, each with the first photos it holds for; process.json has all."""


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
        announce(_made_already(folder))
    for line in report_lines(folder):
        announce(line)
    if not request.keep_work:
        folder.remove_work()
    return folder


def _goes_on_thoroughly(folder: Workspace, request: Request) -> bool:
    """Whether a capture that is made from plain features is to be made from thorough ones.

    What is not in the work folder any more is struck from the record; the capture stays.
    """
    if request.effort != "thorough" or not _may_be_made_thoroughly(folder):
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
        raise CaptureError(_no_model(best.left_out))
    folder.stage("undistortion", lambda: _undistort(folder, request, photos, best))
    folder.stage("findings", lambda: findings_of(best, len(photos)))


def findings_of(best: Attempt, count: int) -> dict[str, Any]:
    """What the report says of a capture from so many photos.

    Of other models, which COLMAP leaves behind where a try failed, those that have no photo more
    are not told.
    """
    model, *others = best.models
    posed = set(model["photos"])
    others = [other["photos"] for other in others if not posed.issuperset(other["photos"])]
    return {
        "photos": best.num_posed,
        "of": count,
        "others": [len(photos) for photos in others],
        "points": model["points"],
        "observations": model["observations"],
        "error": model["error"],
        "recipe": best.recipe.name,
        "left_out": best.left_out,
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


def _no_model(missing: Sequence[Mapping[str, str]]) -> str:
    """The error where no three photos have poses."""
    reasons = (f"{list_names(sources)}: {reason}" for reason, sources in _by_reason(missing))
    return (
        f"No three of the {len(missing)} photos could be put together. {list_names(reasons, 5)}. "
        "Needed are photos that overlap by two thirds, from places some steps apart, sharp, of "
        "something with structure."
    )


def _may_be_made_thoroughly(folder: Workspace) -> bool:
    """Whether a finished capture is one of plain features and the thorough way was not tried."""
    recipe = folder.stages["findings"]["result"]["recipe"]
    return recipe == PLAIN.name and f"mapping ({THOROUGH.name})" not in folder.stages


def _made_already(folder: Workspace) -> str:
    """What to say where nothing is left to do, and what to type to have it done differently."""
    line = f"{folder.output} is made already."
    if _may_be_made_thoroughly(folder):
        line += " To try the thorough way on it, type the same with --effort thorough."
    return f"{line} To make it anew, remove it first: rm -r '{folder.output}'."


def report_lines(folder: Workspace) -> Iterator[str]:
    """The report of a capture that is made."""
    findings = folder.stages["findings"]["result"]
    yield (
        f"{findings['photos']} of {findings['of']} photos have a pose, "
        f"{findings['points']} points, mean reprojection error {findings['error']:.2f} pixels "
        f"({findings['recipe']} features)."
    )
    if findings["others"]:
        sizes = " and ".join(str(size) for size in findings["others"])
        yield (
            f"The photos fell into {len(findings['others']) + 1} models that could not be joined; "
            f"the largest is taken, with {findings['photos']} photos (the others have {sizes})."
        )
    if findings["left_out"]:
        yield f"Left out, with the probable reason (all are in {folder.output / 'process.json'}):"
    reasons = _by_reason(findings["left_out"])
    yield from (f"  {list_names(sources)}: {reason}" for reason, sources in reasons[:LISTED])
    if rest := reasons[LISTED:]:
        count = sum(len(sources) for _, sources in rest)
        yield f"  and {count} more photos, for {len(rest)} other reasons"
    times = (f"{name} {stage['seconds']:.0f} s" for name, stage in folder.stages.items())
    yield f"Time: {', '.join(times)}."
    yield f"Cameras and points from above: {folder.picture}"
    yield f"Train with: ns-train desplat --data '{folder.output}'"


def _by_reason(missing: Iterable[Mapping[str, str]]) -> list[tuple[str, list[str]]]:
    """Each reason with the photos that were left out for it."""
    photos: dict[str, list[str]] = {}
    for photo in missing:
        photos.setdefault(photo["reason"], []).append(photo["source"])
    return list(photos.items())
