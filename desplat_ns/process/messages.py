"""What is said of a capture: matches that do not belong to the scene, and the report at the end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from desplat_ns.console import list_names
from desplat_ns.process.reasons import LeftOut
from desplat_ns.process.recipes import PLAIN, THOROUGH
from desplat_ns.process.workspace import Workspace

LISTED = 20
"""Reasons that are told, each with the first photos it holds for; process.json has all."""

CAMERA_STANDS_STILL = (
    "The camera does not move: matches between photos sit at equal pixel positions, and without "
    "those hardly any are left. Depth is seen from different places only: walk around while taking "
    "photos. If a watermark or a part of the camera's stand is all that matches, the photos share "
    "no place."
)


def about_stationary(matches: Mapping[str, Any], has_mask: bool) -> Iterator[str]:
    """What to say of matches at equal positions; nothing where there are few.

    Args:
        matches: as `matches.match_photos` describes them.
    """
    if not matches["left_out"]:
        return
    share, (left, top, right, bottom) = matches["stationary"]["share"], matches["stationary"]["box"]
    yield (
        f"{share:.0%} of the matches sit at equal pixel positions in both photos, most of them "
        f"{left:.0%} to {right:.0%} from the left and {top:.0%} to {bottom:.0%} from the top: "
        "something stands still in the picture (a watermark, a dashboard, a selfie stick), or the "
        "camera does. Those matches are left out."
        + ("" if has_mask else " To keep features off it: --mask PICTURE, black where it is.")
    )


def no_model(missing: Sequence[LeftOut]) -> str:
    """The error where no three photos have poses."""
    reasons = [f"{photo.source}: {photo.reason}" for photo in missing]
    return (
        f"No three of the {len(missing)} photos could be put together. {list_names(reasons, 5)}. "
        "Needed are photos that overlap by two thirds, from places some steps apart, sharp, of "
        "something with structure."
    )


def may_be_made_thoroughly(folder: Workspace) -> bool:
    """Whether a finished capture is one of plain features and the thorough way was not tried."""
    recipe = folder.stages["findings"]["result"]["recipe"]
    return recipe == PLAIN.name and f"mapping ({THOROUGH.name})" not in folder.stages


def made_already(folder: Workspace) -> str:
    """What to say where nothing is left to do, and what to type to have it done differently."""
    line = f"{folder.output} is made already."
    if may_be_made_thoroughly(folder):
        line += " To try the thorough way on it, type the same with --effort thorough."
    return f"{line} To make it anew, remove it first: rm -r '{folder.output}'."


def report_lines(folder: Workspace) -> Iterator[str]:
    """The report of a capture that is made."""
    told = folder.stages["findings"]["result"]
    yield (
        f"{told['photos']} of {told['of']} photos have a pose, {told['points']} points, mean "
        f"reprojection error {told['error']:.2f} pixels ({told['recipe']} features)."
    )
    if told["others"]:
        sizes = " and ".join(str(size) for size in told["others"])
        yield (
            f"The photos fell into {len(told['others']) + 1} models that could not be joined; the "
            f"largest is taken, with {told['photos']} photos (the others have {sizes})."
        )
    if told["left_out"]:
        yield f"Left out, with the probable reason (all are in {folder.output / 'process.json'}):"
    yield from _by_reason(told["left_out"])
    times = (f"{name} {stage['seconds']:.0f} s" for name, stage in folder.stages.items())
    yield f"Time: {', '.join(times)}."
    yield f"Cameras and points from above: {folder.picture}"
    yield f"Train with: ns-train desplat --data '{folder.output}'"


def _by_reason(missing: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """Lines of photos that were left out for the same reason."""
    photos: dict[str, list[str]] = {}
    for photo in missing:
        photos.setdefault(photo["reason"], []).append(photo["source"])
    for reason, sources in list(photos.items())[:LISTED]:
        yield f"  {list_names(sources)}: {reason}"
    if len(photos) > LISTED:
        rest = sum(map(len, list(photos.values())[LISTED:]))
        yield f"  and {rest} more photos, for {len(photos) - LISTED} other reasons"
