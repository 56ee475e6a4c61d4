"""Photos or a video to a capture: what is missing of it is made, and what came out is said.

    OUTPUT/images         the undistorted photos                 } the capture
    OUTPUT/sparse/0       cameras, poses and points              }
    OUTPUT/cameras.png    cameras and points from above
    OUTPUT/process.json   what was asked for; once the capture is made, the findings
    OUTPUT/work           copies of photos, COLMAP's databases and models; removed at the end

The work folder shows what is done: copies, features in a database, models.
"""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from time import monotonic
from typing import Any

from desplat_ns.console import announce, list_names, progress_with_time_left
from desplat_ns.cores import cores
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.files.whole import IN_USE, check_room, only_process_in, write_whole
from desplat_ns.process.photos import Photo, group_by_camera, prepare_masks, prepare_photos
from desplat_ns.process.reconstruction import FEW, PLAIN, THOROUGH, Attempt, Recipe, reconstruct
from desplat_ns.process.request import MIN_PHOTOS, Request, Sources
from desplat_ns.process.undistortion import undistort

RECORD = "process.json"
BYTES = 4_000_000
"""Of a photo at most: its copies, 8,192 features by two recipes, and their matches."""
LISTED = 20
"""Reasons that are told, each with the first photos it holds for; process.json has all."""
FEW_PHOTOS = 8
"""Below which it is said that they are few."""
BLURRED = 0.25
"""Of the median sharpness of the photos that have a pose."""
FEW_FEATURES = 0.1
"""Of the median number of features of the photos that have a pose."""


def process(request: Request, sources: Sources) -> None:
    """Make the capture, or go on where an earlier call stopped; says what came out.

    Raises:
        ConfigError: the output folder holds something else, or was begun with other options, or
            another process is at work in it; the disk is full, or pycolmap failed. What is done is
            kept.
        CaptureError: too few photos can be used, or nothing ties them together. Nothing is left.
    """
    output = request.output
    with only_process_in(output):
        try:
            record = open_record(output, {**request.lasting(), **sources.sizes()})
            findings = record.get("findings")
            if findings is None:
                findings = _make(request, sources)
                _write_record(output, {**record, "findings": findings})
            else:
                announce(
                    f"{output} is made already. To make it anew, also with another --effort, "
                    f"remove it first: rm -r {shlex.quote(str(output))}."
                )
        except CaptureError:  # other photos may be tried in the folder
            shutil.rmtree(output / "work", ignore_errors=True)
            (output / RECORD).unlink()
            raise
        except (OSError, RuntimeError) as error:
            raise ConfigError(
                f"{output} could not be made ({error}). What is done is kept: the same command "
                "goes on where it stopped. Make room if the disk is full; if that happens again, "
                "name another folder."
            ) from error
        for line in report_lines(output, findings):
            announce(line, warning=line.startswith("Warning"))
        if not request.keep_work:
            shutil.rmtree(output / "work", ignore_errors=True)


# --- the record ----------------------------------------------------------------------------------


def open_record(output: Path, asked: Mapping[str, str]) -> dict[str, Any]:
    """The record of a new folder, or of one in which a call with the same photos and options was at
    work: `asked` and, where the capture is made, `findings`.

    Args:
        asked: what decides what comes out: options, and sources with their sizes.

    Raises:
        ConfigError: something else lies there, or other photos or options were processed there.
        OSError: nothing can be written there.
    """
    path = output / RECORD
    if not path.is_file():
        entries = sorted(place.name for place in output.iterdir() if place.name != IN_USE)
        if entries:
            raise ConfigError(
                f"{output} holds something else: {list_names(entries, 5)}. Nothing is written "
                "over: name a new or an empty folder."
            )
        _write_record(output, {"asked": asked})
        return {"asked": asked}
    if links := [place.name for place in output.rglob("*") if place.is_symlink()]:
        raise ConfigError(
            f"{output} has links ({list_names(links, 5)}), through which nothing is written. Name "
            "another folder."
        )
    try:
        record = json.loads(path.read_text("utf8"))
        had = dict(record["asked"])
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f"{path} cannot be read ({error}). Remove {output} to begin anew, or name another "
            "folder."
        ) from error
    names = dict.fromkeys([*asked, *had])
    changes = [
        f"{name} was {had.get(name, 'not there')} and is {asked.get(name, 'not there')}"
        for name in names
        if had.get(name) != asked.get(name)
    ]
    if changes:
        raise ConfigError(
            f"{output} was begun with other photos or options: {list_names(changes, 5)}. Give the "
            f"same to go on with it, name another folder, or remove {output} to begin anew."
        )
    if "findings" not in record:
        announce(f"Going on in {output}.")
    return record


def _write_record(output: Path, record: Mapping[str, Any]) -> None:
    write_whole(output / RECORD, json.dumps(record, indent=1, ensure_ascii=False).encode())


# --- the stages ----------------------------------------------------------------------------------


def _make(request: Request, sources: Sources) -> dict[str, Any]:
    """Make the capture; its findings."""
    begin, output = monotonic(), request.output
    photos = _usable_photos(request, sources)
    best = _best_attempt(request, sources.is_video, photos)
    missing = left_out(photos, best)
    if not best.models:
        reasons = (f"{list_names(names)}: {reason}" for reason, names in _by_reason(missing))
        raise CaptureError(
            f"No three of the {len(photos)} photos could be put together. {list_names(reasons, 5)}."
            " Needed are photos that overlap by two thirds, from places some steps apart, sharp, "
            "of something with structure."
        )
    model, *others = best.models
    names = {photo.copy: photo.name for photo in photos}
    folder, copies = model.folder, output / "work" / "photos"
    with progress_with_time_left("Undistortion"):
        undistort(folder, copies, output, names, request.longest_side, request.threads or cores())
    # A first try that failed, whose photos are all in the model that is taken, is no other model.
    sizes = [len(o.photos) for o in others if not set(model.photos).issuperset(o.photos)]
    return {
        "photos": len(model.photos),
        "of": len(photos),
        "others": sizes,
        "points": model.points,
        "observations": model.observations,
        "error": model.error,
        "recipe": best.recipe.name,
        "left_out": missing,
        "seconds": round(monotonic() - begin, 1),
    }


def _usable_photos(request: Request, sources: Sources) -> list[Photo]:
    """Copy the photos, or the frames of a video, and say which cannot be used.

    Raises:
        CaptureError: fewer than `MIN_PHOTOS` are left, or the video's camera stands still.
        OSError: nothing can be written.
    """
    work, folder, names = request.output / "work", sources.folder, list(sources.names)
    if sources.is_video:
        from desplat_ns.process.video import take_frames

        folder = work / "frames"
        with progress_with_time_left("Video") as show:
            names = take_frames(sources.folder / names[0], folder, request.frames, show)
    # COLMAP's threads end the process where the disk is full
    check_room(request.output, BYTES * len(names), "copies and features take up to")
    side, threads = request.longest_side, request.threads or cores()
    with progress_with_time_left("Photos") as show:
        photos = prepare_photos(folder, names, work / "photos", side, threads, show)
    problems = [f"{photo.source} ({photo.problem})" for photo in photos if photo.problem]
    good = [photo for photo in photos if not photo.problem]
    if len(good) < MIN_PHOTOS:
        raise CaptureError(
            f"{len(good)} of {len(photos)} photos can be used; at least {MIN_PHOTOS} are needed. "
            f"Not used: {list_names(problems, 5)}."
        )
    if problems:
        unused = f"{len(problems)} of {len(photos)} photos are not used"
        announce(f"{unused}: {list_names(problems)}.", warning=True)
    return good


def _best_attempt(request: Request, is_video: bool, photos: Sequence[Photo]) -> Attempt:
    """The plain way, the thorough one where it leaves photos out, or what was asked for: whichever
    poses more photos."""
    work, masks = request.output / "work", None
    cameras = group_by_camera(photos, request.cameras, request.camera_model)
    announce(f"{len(photos)} photos, {len(cameras)} camera{'s' if len(cameras) > 1 else ''}.")
    if request.mask is not None:
        masks = work / "masks"
        count = prepare_masks(request.mask, photos, masks)
        if count < len(photos):
            unmasked = f"{len(photos) - count} of {len(photos)} photos have no mask"
            announce(f"{unmasked} in {request.mask}.", warning=True)

    def attempt(recipe: Recipe) -> Attempt:
        place, copies, threads = work / recipe.name, work / "photos", request.threads or cores()
        return reconstruct(place, copies, cameras, masks, is_video, recipe, threads)

    if request.effort == "thorough":
        return attempt(THOROUGH)
    plain = attempt(PLAIN)
    posed = plain.score[0]
    if request.effort == "plain" or (posed == len(photos) and not plain.is_thin):
        return plain
    thin = ", which share few points" if plain.is_thin else ""
    announce(
        f"{posed} of {len(photos)} photos have a pose{thin}. Once more, thoroughly: more and truer "
        "features at full size, which takes several times as long (--effort plain leaves that out)."
    )
    return max(plain, attempt(THOROUGH), key=lambda one: one.score)


# --- what came out -------------------------------------------------------------------------------


def left_out(photos: Sequence[Photo], attempt: Attempt) -> list[dict[str, str]]:
    """`source` and the probable `reason` of the photos that are not in the first model: as far as
    features, matches and sharpness tell.

    Args:
        photos: those that could be read.
    """
    posed = set(attempt.models[0].photos) if attempt.models else set()
    others = [model.photos for model in attempt.models[1:]]
    names = {photo.copy: photo.source for photo in photos}
    best = {photo.copy: (0, "") for photo in photos}
    for a, b, count in attempt.pairs:
        best[a] = max(best[a], (count, b))
        best[b] = max(best[b], (count, a))
    usual = [photo for photo in photos if photo.copy in posed or not posed]
    usual_sharpness = median(photo.sharpness for photo in usual)
    usual_features = median(attempt.features[photo.copy] for photo in usual)

    def reason(photo: Photo) -> str:
        for other in others:
            if photo.copy in other:
                return (
                    f"in another model of {len(other)} photos, which shares too little with the "
                    "first: another place, or photos between both are missing"
                )
        count, partner = best[photo.copy]
        matches = f"{count} matches with {names.get(partner)}, but no pose that agrees with others"
        if count == 0:
            matches = "no matches with any other photo: another place, or seen from too far away"
        elif count < 2 * attempt.recipe.pose_inliers:
            matches = f"too few matches ({count} at most, with {names[partner]})"
        sharp, features = photo.sharpness, attempt.features[photo.copy]
        if sharp < BLURRED * usual_sharpness:
            return f"blurred (sharpness {sharp:.0f}, usual {usual_sharpness:.0f}); {matches}"
        if features < FEW_FEATURES * usual_features:
            return f"bare ({features} features, usual {usual_features:.0f}); {matches}"
        return matches

    return [{"source": p.source, "reason": reason(p)} for p in photos if p.copy not in posed]


def report_lines(output: Path, findings: Mapping[str, Any]) -> list[str]:
    """What is said of a capture that is made."""
    photos, points = findings["photos"], findings["points"]
    lines = [
        f"{photos} of {findings['of']} photos have a pose, {points} points, mean reprojection "
        f"error {findings['error']:.2f} pixels ({findings['recipe']} features, "
        f"{findings['seconds']:.0f} s)."
    ]
    if findings["others"]:
        sizes = " and ".join(str(size) for size in findings["others"])
        lines.append(
            f"The photos fell into {len(findings['others']) + 1} models that could not be joined; "
            f"the largest is taken, with {photos} photos (the others have {sizes})."
        )
    reasons = _by_reason(findings["left_out"])
    if reasons:
        lines.append(f"Left out, with the probable reason (all are in {output / RECORD}):")
    lines += [f"  {list_names(sources)}: {reason}" for reason, sources in reasons[:LISTED]]
    if photos < FEW_PHOTOS or findings["observations"] < FEW * photos:
        lines.append(
            f"Warning: {photos} photos with {points} points are few; poses may be off, and what "
            f"moves is hardly told from what stays. Take at least {FEW_PHOTOS} photos, better 20, "
            "that overlap by two thirds."
        )
    lines.append(f"Cameras and points from above: {output / 'cameras.png'}")
    folder = shlex.quote(str(output))
    lines.append(f"Train with: ns-train desplat --data {folder} --timestamp run --vis tensorboard")
    return lines


def _by_reason(missing: Sequence[Mapping[str, str]]) -> list[tuple[str, list[str]]]:
    """Each reason with the photos that were left out for it."""
    photos: dict[str, list[str]] = {}
    for photo in missing:
        photos.setdefault(photo["reason"], []).append(photo["source"])
    return list(photos.items())
