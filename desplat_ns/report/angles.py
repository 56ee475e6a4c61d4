"""Which views of a run can be trusted: how far they are from its photos, and in words."""

from __future__ import annotations

import statistics
from collections.abc import Mapping
from dataclasses import dataclass, replace

from nerfstudio.cameras.cameras import Cameras

from desplat_ns.data.training_views import image_names
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.rendering.views import views_of
from desplat_ns.report.pictures import HeldOutPhoto

MAX_NAMES = 3
"""Photos that are named."""


@dataclass(frozen=True)
class Angles:
    """Degrees from the training photos (`PhotoAngle`), by names; of photos that show a point."""

    held_out: Mapping[str, float]
    training: Mapping[str, float]
    """From the nearest other one: a photo is itself one of the two that count."""

    def added_to(self, photo: HeldOutPhoto) -> HeldOutPhoto:
        """The same with its angle among its figures, if it was measured."""
        measured = {"angle": self.held_out[photo.name]} if photo.name in self.held_out else {}
        return replace(photo, figures={**photo.figures, **measured})


def angles_of(pipeline: DeSplatPipeline) -> Angles:
    """Measure all photos; nothing where the scene did not start from a reconstruction."""
    model, manager = pipeline.model, pipeline.datamanager
    if not model.has_points:
        return Angles({}, {})

    def of(cameras: Cameras, names: list[str]) -> dict[str, float]:
        views = views_of(cameras.to(pipeline.device))
        measured = zip(names, map(model.photo_angle.degrees, views), strict=True)
        return {name: degrees for name, degrees in measured if degrees is not None}

    held_out = manager.eval_dataset
    return Angles(
        of(held_out.cameras, image_names(held_out.image_filenames)),
        of(manager.train_dataset.cameras, manager.train_image_names),
    )


def in_words(angles: Angles) -> str:
    """Which views can be trusted; empty where nothing was measured."""
    said = []
    if angles.held_out:
        middle = statistics.median(angles.held_out.values())
        said.append(
            "Within how many degrees two training photos see half of what a view shows says how "
            f"far it can be trusted: {middle:.0f}° in the middle of the held-out photos, and most "
            f"in {_farthest(angles.held_out)}."
        )
    if angles.training:
        said.append(
            "Training photos that stand most alone, so that new views beside them rest on few "
            f"photos: {_farthest(angles.training)}."
        )
    return " ".join(said)


def _farthest(angles: Mapping[str, float]) -> str:
    names = sorted(angles, key=lambda name: -angles[name])[:MAX_NAMES]
    return ", ".join(f"{name} ({angles[name]:.0f}°)" for name in names)
