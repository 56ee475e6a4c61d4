"""Features, matches and poses: the cheap way first, the thorough one where that is not enough; and
why a photo was left out, as far as its features, matches and sharpness tell."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from desplat_ns.console import announce
from desplat_ns.errors import CaptureError
from desplat_ns.process.cameras import Camera
from desplat_ns.process.jobs import run_job
from desplat_ns.process.photos import Photo
from desplat_ns.process.recipes import PLAIN, THOROUGH, Recipe
from desplat_ns.process.request import MIN_PHOTOS, Request
from desplat_ns.process.workspace import Workspace

FEW = 200
"""Observations of each photo on average below which poses are not relied on: with 130 the centres
of ten tourists' photos were off by percents of the scene's extent, with 700 by a thousandth."""
BLURRED = 0.25
"""Of the median sharpness of the photos that have a pose."""
FEW_FEATURES = 0.1
"""Of the median number of features of the photos that have a pose."""

CAMERA_STANDS_STILL = (
    "The camera does not move: matches between photos sit at equal pixel positions, and without "
    "those hardly any are left. Depth is seen from different places only: walk around while taking "
    "photos. If a watermark or a part of the camera's stand is all that matches, the photos share "
    "no place."
)


@dataclass(frozen=True)
class Task:
    """What both ways start from."""

    folder: Workspace
    request: Request
    photos: Sequence[Photo]
    cameras: Sequence[Camera]
    masks: Path | None
    pairing: str
    """How pairs are chosen."""


@dataclass(frozen=True)
class Attempt:
    """What came out of one way."""

    recipe: Recipe
    models: Sequence[Mapping[str, Any]]
    """As `mapping.map_photos` describes them, the one with most photos first."""
    left_out: Sequence[Mapping[str, str]]
    """`source` and `reason` of photos that are not in the first model."""

    @property
    def is_thin(self) -> bool:
        """Whether poses hang on few observations."""
        return bool(self.models) and self.models[0]["observations"] < FEW * self.num_posed

    @property
    def num_posed(self) -> int:
        """Photos in the first model."""
        return len(self.models[0]["photos"]) if self.models else 0

    def score(self) -> tuple[int, int]:
        """More photos are better, and with as many more observations."""
        return self.num_posed, self.models[0]["observations"] if self.models else 0


def best_attempt(task: Task) -> Attempt:
    """Whichever way poses more photos.

    Raises:
        CaptureError: the camera stands still.
        DeSplatError: pycolmap failed.
    """
    if task.request.effort == "thorough":
        return _attempt(task, THOROUGH)
    plain = _attempt(task, PLAIN)
    if task.request.effort == "plain" or not (plain.left_out or plain.is_thin):
        return plain
    thin = ", which share few points" if plain.is_thin else ""
    announce(
        f"{plain.num_posed} of {len(task.photos)} photos have a pose{thin}. Once more, thoroughly: "
        "more and truer features at full size, which takes several times as long (--effort plain "
        "leaves that out)."
    )
    return max(plain, _attempt(task, THOROUGH), key=Attempt.score)


def _attempt(task: Task, recipe: Recipe) -> Attempt:
    place, copies = task.folder.work / recipe.name, task.folder.work / "photos"
    place.mkdir(parents=True, exist_ok=True)
    pairs_file = place / "pairs.json"
    common = {
        "database": place / "database.db",
        "recipe": recipe,
        "threads": task.request.num_threads,
    }

    def run(stage: str, job: str, **arguments: Any) -> Any:
        label, given = f"{stage} ({recipe.name})", {**common, **arguments}
        job = f"desplat_ns.process.{job}"
        return task.folder.stage(label, lambda: run_job(task.folder, label, job, given))

    given = {"photos": copies, "cameras": task.cameras, "masks": task.masks}
    features = run("features", "features.find_features", **given)
    matches = run("matching", "matches.match_photos", pairing=task.pairing, pairs_file=pairs_file)
    if matches["left_out"]:
        announce(_about_stationary(matches["stationary"], task.masks is not None), warning=True)
    pairs = [(a, b, count) for a, b, count in json.loads(pairs_file.read_text("utf8"))]
    if matches["left_out"] and len(pairs) < MIN_PHOTOS - 1:
        raise CaptureError(CAMERA_STANDS_STILL)
    models = run("mapping", "mapping.map_photos", photos=copies, models=place / "models")
    posed = [model["photos"] for model in models]
    missing = left_out(task.photos, posed, features, pairs, recipe.pose_inliers)
    return Attempt(recipe, models, missing)


def _about_stationary(stationary: Mapping[str, Any], has_mask: bool) -> str:
    """What to say of matches at equal positions, see `matches.summarise`."""
    left, top, right, bottom = stationary["box"]
    return (
        f"{stationary['share']:.0%} of the matches sit at equal pixel positions in both photos, "
        f"most of them {left:.0%} to {right:.0%} from the left and {top:.0%} to {bottom:.0%} from "
        "the top: something stands still in the picture (a watermark, a dashboard, a selfie "
        "stick), or the camera does. Those matches are left out."
        + ("" if has_mask else " To keep features off it: --mask PICTURE, black where it is.")
    )


def left_out(
    photos: Sequence[Photo],
    models: Sequence[Sequence[str]],
    features: Mapping[str, int],
    pairs: Sequence[tuple[str, str, int]],
    pose_inliers: int,
) -> list[dict[str, str]]:
    """`source` and `reason` of the photos that are not in the first model.

    Args:
        photos: those that could be read.
        models: the copies' names in each model, the one that is taken first.
        features: of each copy.
        pairs: names of copies and their verified matches.
        pose_inliers: matches that a pose needs.
    """
    posed = set(models[0]) if models else set()
    names = {photo.copy: photo.source for photo in photos}
    best = _best_partners(pairs)
    usual = [photo for photo in photos if photo.copy in posed or not posed]
    usual_sharpness = median(photo.sharpness for photo in usual)
    usual_features = median(features[photo.copy] for photo in usual)

    def reason(photo: Photo) -> str:
        others = [model for model in models[1:] if photo.copy in model]
        if others:
            return (
                f"in another model of {len(others[0])} photos, which shares too little with the "
                "first: another place, or photos between both are missing"
            )
        matches = _matches_of(best.get(photo.copy), names, pose_inliers)
        sharp, count = photo.sharpness, features[photo.copy]
        if sharp < BLURRED * usual_sharpness:
            return f"blurred (sharpness {sharp:.0f}, usual {usual_sharpness:.0f}); {matches}"
        if count < FEW_FEATURES * usual_features:
            return f"bare ({count} features, usual {usual_features:.0f}); {matches}"
        return matches

    return [{"source": p.source, "reason": reason(p)} for p in photos if p.copy not in posed]


def _best_partners(pairs: Sequence[tuple[str, str, int]]) -> dict[str, tuple[int, str]]:
    best: dict[str, tuple[int, str]] = {}
    for a, b, count in pairs:
        best[a] = max(best.get(a, (0, "")), (count, b))
        best[b] = max(best.get(b, (0, "")), (count, a))
    return best


def _matches_of(best: tuple[int, str] | None, names: Mapping[str, str], pose_inliers: int) -> str:
    if best is None:
        return "no matches with any other photo: another place, or seen from too far away"
    count, partner = best
    if count < 2 * pose_inliers:
        return f"too few matches ({count} at most, with {names[partner]})"
    return f"{count} matches with {names[partner]}, but no pose that agrees with the others"
