"""What stands out in a run, and what to try, in plain words."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from desplat_ns.console import list_names
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.report.pictures import Rgb, TrainingPhoto, marked
from desplat_ns.report.recorded import Cost, EffectReason
from desplat_ns.report.views import Alone, Disputed
from desplat_ns.separation.placement import FEW_VIEWS, about_few_views
from desplat_ns.settings.effects import AppearanceGrade, BackgroundGrade
from desplat_ns.training.schedule import steps_for_visits

ENOUGH_VISITS = 150.0
"""Of each photo; after these at most a decibel was gained where it was measured."""

LONG = 30_000
"""Steps; a run of as many is long, however many photos there are."""

HARDLY = 0.001
"""Share of the photos. Distractors that cover less have found nothing."""

MUCH = 0.5
"""Share of a photo. The scene behind distractors that cover more is known from other photos alone.
If they cover more of most photos, nothing is: a median over the views, which is what separates,
needs places to be free in most of them."""

FAR_BELOW = 5.0
"""dB by which a held-out photo is worse than the median before it is named."""

WIDE_GAP = 8.0
"""dB between training photos and held-out photos, above which a scene is learned by heart."""

MAX_NAMES, MAX_PARTS = 5, 3
"""Photos, and photos with parts of the scene that they show alone, that are named."""

GRADES = {"appearance": get_args(AppearanceGrade), "background": get_args(BackgroundGrade)}

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
    picture: Rgb | None = None


def notices(
    cost: Cost,
    reasons: Sequence[EffectReason],
    photos: Sequence[TrainingPhoto],
    results: Mapping[str, Any],
    distractors: DistractorConfig | None,
    disputed: Disputed | None,
    alone: Sequence[Alone],
) -> list[Notice]:
    """Everything that stands out, what matters most first.

    Args:
        photos: that were rendered.
        results: of the evaluation; empty without one.
        distractors: their settings; None in a run without them.
        disputed: places that most photos do not show.
        alone: photos that show parts of the scene alone.
    """
    return [
        *([] if distractors is None else _of_distractors(photos, distractors)),
        *([] if disputed is None else [_of_places(disputed, photos)]),
        *_of_capture(cost, distractors, alone),
        *_of_scores(results, photos),
        *_of_choices(cost, reasons),
    ]


def _of_distractors(photos: Sequence[TrainingPhoto], config: DistractorConfig) -> Iterator[Notice]:
    shares = {photo.name: photo.covered or 0.0 for photo in photos}
    names = sorted((k for k, share in shares.items() if share > MUCH), key=lambda k: -shares[k])
    excess = f"{DISTRACTORS}.strong-excess (now {config.strong_excess:g})"
    dearer = f"a higher {DISTRACTORS}.lambda-d (now {config.lambda_d:g})"
    if config.start == "residual":
        dearer = f"a higher {excess} or {dearer.removeprefix('a higher ')}"
    if 2 * len(names) > len(photos):
        yield Notice(
            f"Distractors cover more than {MUCH:.0%} of {len(names)} of {len(photos)} photos, most "
            f"of {list_names(names, MAX_NAMES)}.",
            "They begin to explain the static scene, which cannot be learned behind them. Where "
            "the light, the weather or the sky changes from photo to photo: "
            f"{FOR_LIGHT_AND_SKY}. Else {dearer}.",
        )
    elif names:
        yield Notice(
            f"Distractors cover more than {MUCH:.0%} of {list_names(names, MAX_NAMES)}.",
            "Look at them below. A photo that shows little of the scene can be left out of the "
            f"capture; if what is covered belongs to the scene, try {dearer}.",
        )
    if shares and statistics.fmean(shares.values()) <= HARDLY:
        yield Notice(
            "Distractors cover next to nothing: either nothing is in the way, or it was not found.",
            f"If you see something in the way: more steps, or a lower {excess}.",
        )


def _of_places(disputed: Disputed, photos: Sequence[TrainingPhoto]) -> Notice:
    names = disputed.names
    pictures = [marked(p.photo, disputed.where) for p in photos if p.name == names[0]]
    return Notice(
        f"Of {disputed.share:.0%} of the scene nobody can tell what it is: most photos that see it "
        f"show something else there, above all {list_names(names, MAX_NAMES)}.",
        "Something may stand in the same place in many photos, and be in the static scene now: "
        "leave some of these photos out, mask it, or add photos without it. If it is a part of "
        f"the scene that changes, as clouds do: {FOR_LIGHT_AND_SKY}.",
        *pictures[:1],
    )


def _of_capture(
    cost: Cost, distractors: DistractorConfig | None, alone: Sequence[Alone]
) -> Iterator[Notice]:
    if cost.steps < cost.planned and not cost.budget:  # a budget ends by its clock
        yield Notice(
            f"The run has {cost.steps:,} of {cost.planned:,} steps: it was stopped, or this is "
            "one of its earlier checkpoints.",
            "Go on with --load-dir and the folder of its checkpoints.",
        )
    by_others = distractors is not None and distractors.start == "residual"
    if by_others and cost.num_photos < FEW_VIEWS:
        yield Notice(about_few_views(cost.num_photos))
    if alone:
        parts = [f"{photo.name} ({100 * photo.share:.0f}%, {photo.side} part)" for photo in alone]
        yield Notice(
            f"Parts of the scene that one photo alone shows: {list_names(parts, MAX_PARTS)}.",
            "The next photos are worth most there: step to the side of where these were taken, "
            "and look at that part.",
        )


def _of_scores(results: Mapping[str, Any], photos: Sequence[TrainingPhoto]) -> Iterator[Notice]:
    scores = {row["name"]: row["psnr"] for row in results.get("images", ()) if "psnr" in row}
    median = statistics.median(scores.values()) if scores else 0.0
    ranked = sorted(scores, key=scores.__getitem__)
    low = [name for name in ranked if scores[name] < median - FAR_BELOW]
    if low and len(scores) >= 3:
        yield Notice(
            f"Held out and far worse than the others ({median:.1f} dB): "
            f"{list_names(low, MAX_NAMES)}.",
            "Look at their error maps. Bright everywhere: the pose or the light of the photo is "
            "off. Bright in one place: something is in the way there, or no training photo shows "
            "it.",
        )
    held_out = results.get("psnr")
    if held_out is None or not photos:
        return
    ours = statistics.fmean(photo.psnr for photo in photos)
    if ours - held_out >= WIDE_GAP:
        yield Notice(
            f"Training photos are explained at {ours:.1f} dB, held-out photos at {held_out:.1f} "
            "dB: views between the photos are much worse than the photos.",
            "More photos help.",
        )


def _of_choices(cost: Cost, reasons: Sequence[EffectReason]) -> Iterator[Notice]:
    for reason in reasons:
        if reason.is_unsure:
            others = [grade for grade in GRADES[reason.effect] if grade != reason.value]
            yield Notice(
                f"The survey was not sure about {reason.effect} ({reason.value}).",
                f"Compare with a run that has --pipeline.model.effects.{reason.effect} "
                f"{' or '.join(others)}.",
            )
    enough = steps_for_visits(ENOUGH_VISITS, cost.num_photos, LONG)
    if cost.steps < enough:
        yield Notice(
            f"Each photo was seen {cost.visits:.0f} times.",
            "More steps may still help: a larger --max-num-iterations. After "
            f"{enough:,} at most a decibel was gained on the captures that it was measured on.",
        )
