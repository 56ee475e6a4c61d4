"""Photos or a video to a capture: what is missing of it is made, and what came out is said.

    OUTPUT/images         the undistorted photos                 } the capture
    OUTPUT/sparse/0       cameras, poses and points              }
    OUTPUT/originals      the model of the photos as they were given
    OUTPUT/cameras.png    cameras and points from above
    OUTPUT/process.json   what was asked for; once the capture is made, the findings
    OUTPUT/work           copies of photos, COLMAP's databases and models; removed at the end

COLMAP's databases show what is done: photos with features, pairs with matches.
"""

import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

from desplat_ns.core.console import announce, list_names, says_what_is_next
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.options import option_of
from desplat_ns.core.whole import begun_record, check_room, only_process_in, write_record
from desplat_ns.tools.process.photos import Photo, group_by_camera, prepare_masks, prepare_photos
from desplat_ns.tools.process.reconstruction import FEW, PLAIN, THOROUGH, Attempt, reconstruct
from desplat_ns.tools.process.request import MIN_PHOTOS, Request
from desplat_ns.tools.process.undistortion import undistort
from desplat_ns.tools.process.video import take_frames

RECORD = "process.json"
BYTES = 4_000_000
"""Of a photo at most: its copies, 8,192 features by two recipes, and their matches."""
FEW_PHOTOS = 8
"""Below which it is said that they are few."""
BLURRED = 0.25
"""Of the median sharpness of the photos that have a pose."""
FEW_FEATURES = 0.1
"""Of the median number of features of the photos that have a pose."""


def process(request: Request, names: Sequence[str]) -> None:
    """Make the capture of photos of these names below their folder, or of a video, or go on where
    an earlier call stopped; says what came out. Raises ConfigError where the output folder will not
    do, the disk is full, or pycolmap failed, and keeps what is done; CaptureError where too few
    photos can be used, or nothing ties them together, and leaves nothing."""
    output, asked = request.output, {"PHOTOS": str(request.photos.resolve())}
    for name in ("longest_side", "cameras", "camera_model", "mask", "frames"):
        asked[option_of(name)] = str(getattr(request, name))
    for name in names or [""]:  # a file of another size is not the same any more
        asked[name or request.photos.name] = f"{(request.photos / name).stat().st_size} bytes"
    with only_process_in(output):
        try:
            if is_made(output, asked):
                announce(
                    f"{output} is made already; {RECORD} in it says what came out. To make it "
                    f"anew, also with another --effort: rm -r {shlex.quote(str(output))}."
                )
            else:
                findings = _make(request, names)
                write_record(output / RECORD, {"asked": asked, "findings": findings})
                for line in report_lines(output, findings):
                    announce(line, warning=line.startswith("Warning"))
        except CaptureError:  # other photos may be tried in the folder
            shutil.rmtree(output / "work", ignore_errors=True)
            (output / RECORD).unlink()
            raise
        except (OSError, RuntimeError) as error:
            raise ConfigError(
                f"{output} could not be made ({error}). What is done is kept: the same command "
                "goes on. Make room if the disk is full; if that is not it, name another folder."
            ) from error
        if not request.keep_work:
            shutil.rmtree(output / "work", ignore_errors=True)


def is_made(output: Path, asked: Mapping[str, str]) -> bool:
    """Whether the capture is there. In a new folder the record is begun; in one with a record, a
    call with the same photos and options was at work. `asked`: options, and sources with their
    sizes. Raises ConfigError where something else lies there, or others were processed there."""
    record = begun_record(output / RECORD, {"asked": dict(asked)})
    had = record["asked"]
    if changes := [name for name in {**asked, **had} if had.get(name) != asked.get(name)]:
        raise ConfigError(
            f"{output} was begun with other photos or options: {list_names(changes, 5)}. Give the "
            f"same to go on with it, name another folder, or remove {output} to begin anew."
        )
    return "findings" in record


def _make(request: Request, names: Sequence[str]) -> dict[str, Any]:
    """Make the capture; its findings."""
    photos = _usable_photos(request, names)
    best = _best_attempt(request, photos)
    model, missing = best.first, left_out(photos, best)
    if len(model.photos) < MIN_PHOTOS:
        reasons = " ".join(f"{list_names(names)}: {why}." for why, names in missing.items())
        raise CaptureError(
            f"No three of the {len(photos)} photos could be put together. {reasons} Needed are "
            "sharp photos that overlap by two thirds, from different places, of some structure."
        )
    undistort(request, model, photos)
    return {
        "photos": len(model.photos),
        "of": len(photos),
        "points": model.points,
        "observations": model.observations,
        "error": model.error,
        "is_bent": model.is_bent,
        "left_out": missing,
    }


def _usable_photos(request: Request, names: Sequence[str]) -> list[Photo]:
    """Copy the photos, or the frames of a video, and say which cannot be used. Raises CaptureError
    where fewer than `MIN_PHOTOS` are left, or the video's camera stands still."""
    work, folder = request.output / "work", request.photos
    if request.is_video:
        folder = work / "frames"
        names = take_frames(request.photos, folder, request.frames)
    # COLMAP's threads end the process where the disk is full
    check_room(request.output, BYTES * len(names), "copies and features take up to")
    photos = prepare_photos(folder, names, work / "photos", request.longest_side)
    reasons: dict[str, list[str]] = {}
    for photo in photos:
        reasons.setdefault(photo.problem, []).append(photo.source)
    good = [photo for photo in photos if not photo.problem]
    problems = [f"{list_names(names, 5)} ({why})" for why, names in reasons.items() if why]
    if len(good) < MIN_PHOTOS:
        raise CaptureError(
            f"{len(good)} of {len(photos)} photos of {request.photos} can be used; at least "
            f"{MIN_PHOTOS} are needed. Not used: {list_names(problems, 5)}."
        )
    if problems:
        unused = f"{len(photos) - len(good)} of {len(photos)} photos are not used"
        announce(f"{unused}: {list_names(problems)}.", warning=True)
    return good


def _best_attempt(request: Request, photos: Sequence[Photo]) -> Attempt:
    """The plain way; where it falls short also without EXIF's focal lengths, then the thorough one;
    or what was asked for. Whichever has the best score."""
    cameras = group_by_camera(photos, request.cameras)
    announce(f"{len(photos)} photos, {len(cameras)} camera{'s' if len(cameras) > 1 else ''}.")
    if request.mask is not None:
        count = prepare_masks(request.mask, photos, request.output / "work" / "masks")
        announce(f"{count} of {len(photos)} photos have a mask.")
    first = THOROUGH if request.effort == "thorough" else PLAIN
    best = reconstruct(request, photos, first)
    known = [photo for photo in photos if photo.focal]
    if known and (why := shortfall(best, len(photos))):
        free = [replace(photo, focal_35mm=0.0) for photo in photos]
        without = reconstruct(request, free, first)
        if without.score[0] > best.score[0]:
            best, photos = without, free
            lengths = dict.fromkeys(f"{photo.focal_35mm:.0f} mm" for photo in known)
            announce(
                f"{why} EXIF of {len(known)} photos says that the focal length is "
                f"{list_names(lengths, 3)} (as on 35 mm film). Poses are better without it.",
                warning=True,
            )
    if request.effort != "auto" or not (why := shortfall(best, len(photos))):
        return best
    announce(
        f"{why} Once more, thoroughly: more and truer features at full size, which takes several "
        "times as long (--effort plain leaves that out)."
    )
    return max(best, reconstruct(request, photos, THOROUGH), key=lambda one: one.score)


def shortfall(attempt: Attempt, of: int) -> str:
    """Why an attempt with `of` photos asks for another; empty where it does not."""
    first = attempt.first
    posed = len(first.photos)
    thin = ", which share few points" if first.observations < FEW * posed else ""
    bent = f", with {first.error:.2f} pixels of reprojection error" if first.is_bent else ""
    return f"{posed} of {of} photos have a pose{thin}{bent}." if posed < of or thin or bent else ""


def left_out(photos: Sequence[Photo], attempt: Attempt) -> dict[str, list[str]]:
    """The probable reasons why photos are not in the first model, as far as features, matches and
    sharpness tell, each with the sources that it holds for."""
    posed = set(attempt.first.photos)
    usual = [photo for photo in photos if photo.copy in posed or not posed]
    sharp = BLURRED * median(photo.sharpness for photo in usual)
    many = FEW_FEATURES * median(attempt.features[photo.copy] for photo in usual)
    best = dict.fromkeys(attempt.features, 0)
    for a, b, count in attempt.pairs:
        best[a], best[b] = max(best[a], count), max(best[b], count)

    def reason(photo: Photo) -> str:
        for other in attempt.models[1:]:
            if photo.copy in other.photos:
                return (
                    f"in another model of {len(other.photos)} photos, which shares too little with "
                    "the first: another place, or photos between both are missing"
                )
        if photo.sharpness < sharp:
            return "blurred"
        if attempt.features[photo.copy] < many:
            return "bare, with hardly any features"
        if best[photo.copy] == 0:
            return "no matches with any other photo: another place, or seen from too far away"
        if best[photo.copy] < 2 * attempt.recipe.pose_inliers:
            return "too few matches with any other photo"
        return "matches with other photos, but no pose that agrees with others"

    reasons: dict[str, list[str]] = {}
    for photo in photos:
        if photo.copy not in posed:
            reasons.setdefault(reason(photo), []).append(photo.source)
    return reasons


def report_lines(output: Path, findings: Mapping[str, Any]) -> list[str]:
    """What is said of a capture that is made."""
    photos, points = findings["photos"], findings["points"]
    error = f"mean reprojection error {findings['error']:.2f} pixels"
    lines = [f"{photos} of {findings['of']} photos have a pose, {points} points, {error}."]
    if findings["left_out"]:
        lines.append(f"Left out, with the probable reason (all are in {output / RECORD}):")
    lines += [f"  {list_names(names)}: {why}" for why, names in findings["left_out"].items()]
    if photos < FEW_PHOTOS or findings["observations"] < FEW * photos:
        lines.append(
            f"Warning: {photos} photos with {points} points are few; poses may be off. Take at "
            f"least {FEW_PHOTOS} photos, better 20, that overlap by two thirds."
        )
    lines.append(f"Cameras and points from above: {output / 'cameras.png'}")
    folder = shlex.quote(str(output))
    train = f"Train with: ns-train desplat --data {folder} --timestamp run --vis tensorboard"
    bent = (
        "Warning: this reprojection error is about twice the usual or more: poses are off, and not "
        "worth training. It comes from zoom that changes (try --cameras photo, with another "
        "OUTPUT), a rolling shutter, pictures of 360 degrees, or things that move."
    )
    return [*lines, *([bent] if findings["is_bent"] else [train] * (not says_what_is_next()))]
