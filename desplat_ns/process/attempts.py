"""Features, matches and poses: the cheap way first, the thorough one where that is not enough."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.console import announce
from desplat_ns.errors import CaptureError
from desplat_ns.process.cameras import Camera
from desplat_ns.process.jobs import run_job
from desplat_ns.process.messages import CAMERA_STANDS_STILL, about_stationary
from desplat_ns.process.photos import Photo
from desplat_ns.process.reasons import LeftOut, left_out
from desplat_ns.process.recipes import PLAIN, THOROUGH, Recipe
from desplat_ns.process.request import MIN_PHOTOS, Request
from desplat_ns.process.workspace import Workspace

FEW = 200
"""Observations of each photo on average below which poses are not relied on: with 130 the centres
of ten tourists' photos were off by percents of the scene's extent, with 700 by a thousandth."""


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
    left_out: Sequence[LeftOut]
    """Of the first model."""

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

    features = run(
        "features",
        "features.find_features",
        photos=copies,
        cameras=task.cameras,
        masks=task.masks,
    )
    matches = run("matching", "matches.match_photos", pairing=task.pairing, pairs_file=pairs_file)
    for line in about_stationary(matches, task.masks is not None):
        announce(line, warning=True)
    pairs = [(a, b, count) for a, b, count in json.loads(pairs_file.read_text("utf8"))]
    if matches["left_out"] and len(pairs) < MIN_PHOTOS - 1:
        raise CaptureError(CAMERA_STANDS_STILL)
    models = run("mapping", "mapping.map_photos", photos=copies, models=place / "models")
    posed = [model["photos"] for model in models]
    missing = left_out(task.photos, posed, features, pairs, recipe.pose_inliers)
    return Attempt(recipe, models, missing)
