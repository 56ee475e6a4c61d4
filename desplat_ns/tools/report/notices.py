"""What stands out in a run, and what to try, in plain words."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from desplat_ns.core.console import list_names
from desplat_ns.core.pages import Picture
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.tools.report.pictures import ShownPhoto, marked
from desplat_ns.tools.report.views import Disputed

HARDLY = 0.001
"""Share of the photos. Distractors that cover less have found nothing."""
MUCH = 0.5
"""Share of a photo. A median over the views, which is what separates, needs places to be free in
most of them."""
MAX_NAMES, MAX_PARTS = 5, 3
"""Photos, and photos with parts of the scene that they show alone, that are named."""
DISTRACTORS = "--pipeline.model.distractors"
FOR_LIGHT_AND_SKY = (
    "--pipeline.model.effects.appearance affine, and --pipeline.model.effects.background image for "
    "the sky"
)


@dataclass(frozen=True)
class Notice:
    """Something that stands out, what may be done about it, and a picture of where."""

    what: str
    advice: str = ""
    picture: Picture | None = None


def notices(
    steps: int,
    planned: int | None,
    photos: Sequence[ShownPhoto],
    distractors: DistractorConfig | None,
    disputed: Disputed | None,
    alone: Mapping[str, float],
) -> Iterator[Notice]:
    """Everything that stands out, what matters most first.

    Args:
        steps, planned: done, and of the whole run; None if the clock set its end.
        distractors: their settings; None in a run without them.
        alone: photos that show parts of the scene alone, and how large a share of what they show.
    """
    shares = {photo.name: photo.covered or 0.0 for photo in photos}
    if distractors is not None and shares:
        excess = f"{DISTRACTORS}.strong-excess (now {distractors.strong_excess:g})"
        dearer = f"a higher {DISTRACTORS}.lambda-d (now {distractors.lambda_d:g})"
        if distractors.start == "residual":
            dearer = f"a higher {excess}, or {dearer}"
        ranked = sorted(shares, key=lambda name: -shares[name])
        if names := [name for name in ranked if shares[name] > MUCH]:
            yield Notice(
                f"Distractors cover more than {MUCH:.0%} of {len(names)} of {len(photos)} photos, "
                f"most of {list_names(names, MAX_NAMES)}.",
                "The scene behind them is known from other photos alone; if most photos are "
                "covered, it cannot be learned. Photos that show little of the scene can be left "
                "out of the capture. Where the light, the weather or the sky changes from photo to "
                f"photo: {FOR_LIGHT_AND_SKY}. If what is covered belongs to the scene: {dearer}.",
            )
        if statistics.fmean(shares.values()) <= HARDLY:
            yield Notice(
                "Distractors cover next to nothing: either nothing is in the way, or it was not "
                "found.",
                f"If you see something in the way: more steps, or a lower {excess}.",
            )
    if disputed is not None:
        first = next((photo for photo in photos if photo.name == disputed.names[0]), None)
        yield Notice(
            f"Of {disputed.share:.0%} of the scene nobody can tell what it is: most photos that "
            "see it show something else there, above all "
            f"{list_names(disputed.names, MAX_NAMES)}.",
            "Something may stand in the same place in many photos, and be in the static scene now: "
            "leave some of these photos out, mask it, or add photos without it. If it is a part of "
            f"the scene that changes, as clouds do: {FOR_LIGHT_AND_SKY}.",
            first and marked(first, disputed.where),
        )
    if planned is not None and steps < planned:
        yield Notice(
            f"The run has {steps:,} of {planned:,} steps: it was stopped, or this is one of its "
            "earlier checkpoints.",
            "Go on with --load-dir and the folder of its checkpoints.",
        )
    if alone:
        parts = [f"{name} ({share:.0%})" for name, share in alone.items()]
        yield Notice(
            f"Parts of the scene that one photo alone shows: {list_names(parts, MAX_PARTS)}.",
            "The next photos are worth most there: a step to the side of where these were taken, "
            "of the same things.",
        )
