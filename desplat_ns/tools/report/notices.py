"""What stands out in a run, and what to try, in plain words."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from desplat_ns.core.console import list_names
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.tools.pages import Picture
from desplat_ns.tools.report.pictures import Photo, marked
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
    photos: Sequence[Photo],
    distractors: DistractorConfig | None,
    disputed: Disputed | None,
    alone: Mapping[str, float],
) -> list[Notice]:
    """Everything that stands out, what matters most first.

    Args:
        steps, planned: done, and of the whole run; None if the clock set its end.
        distractors: their settings; None in a run without them.
        alone: photos that show parts of the scene alone, and how large a share of what they show.
    """
    return [
        *([] if distractors is None else _of_distractors(photos, distractors)),
        *([] if disputed is None else [_of_places(disputed, photos)]),
        *_of_run(steps, planned, alone),
    ]


def _of_distractors(photos: Sequence[Photo], config: DistractorConfig) -> Iterator[Notice]:
    shares = {photo.name: photo.covered or 0.0 for photo in photos}
    names = sorted((k for k, share in shares.items() if share > MUCH), key=lambda k: -shares[k])
    excess = f"{DISTRACTORS}.strong-excess (now {config.strong_excess:g})"
    dearer = f"a higher {DISTRACTORS}.lambda-d (now {config.lambda_d:g})"
    if config.start == "residual":
        dearer = f"a higher {excess}, or {dearer}"
    if names:
        yield Notice(
            f"Distractors cover more than {MUCH:.0%} of {len(names)} of {len(photos)} photos, most "
            f"of {list_names(names, MAX_NAMES)}.",
            "The scene behind them is known from other photos alone; if most photos are covered, "
            "it cannot be learned. Photos that show little of the scene can be left out of the "
            "capture. Where the light, the weather or the sky changes from photo to photo: "
            f"{FOR_LIGHT_AND_SKY}. If what is covered belongs to the scene: {dearer}.",
        )
    if shares and statistics.fmean(shares.values()) <= HARDLY:
        yield Notice(
            "Distractors cover next to nothing: either nothing is in the way, or it was not found.",
            f"If you see something in the way: more steps, or a lower {excess}.",
        )


def _of_places(disputed: Disputed, photos: Sequence[Photo]) -> Notice:
    names = disputed.names
    pictures = [marked(p, disputed.where) for p in photos if p.name == names[0]]
    return Notice(
        f"Of {disputed.share:.0%} of the scene nobody can tell what it is: most photos that see it "
        f"show something else there, above all {list_names(names, MAX_NAMES)}.",
        "Something may stand in the same place in many photos, and be in the static scene now: "
        "leave some of these photos out, mask it, or add photos without it. If it is a part of "
        f"the scene that changes, as clouds do: {FOR_LIGHT_AND_SKY}.",
        *pictures[:1],
    )


def _of_run(steps: int, planned: int | None, alone: Mapping[str, float]) -> Iterator[Notice]:
    if planned is not None and steps < planned:
        yield Notice(
            f"The run has {steps:,} of {planned:,} steps: it was stopped, or this "
            "is one of its earlier checkpoints.",
            "Go on with --load-dir and the folder of its checkpoints.",
        )
    if alone:
        parts = [f"{name} ({share:.0%})" for name, share in alone.items()]
        yield Notice(
            f"Parts of the scene that one photo alone shows: {list_names(parts, MAX_PARTS)}.",
            "The next photos are worth most there: a step to the side of where these were taken, "
            "of the same things.",
        )
