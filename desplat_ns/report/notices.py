"""What stands out in a run, and what to try, in plain words."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from desplat_ns.console import list_names
from desplat_ns.report.cost import Cost
from desplat_ns.report.effect_reasons import EffectReason
from desplat_ns.report.pictures import TrainingPhoto
from desplat_ns.separation.placement import FEW_VIEWS, about_few_views

BEST_VISITS = 150
"""Of each photo, by `desplat-best`; after these nothing more was gained where it was measured."""

LONG = 30_000
"""Steps; a run of as many is long, however many photos there are."""

HARDLY = 0.001
"""Share of the photos. Distractors that cover less have found nothing."""

MUCH = 0.5
"""Share of a photo. What is behind distractors that cover more is known from other photos alone."""

FAR_BELOW = 5.0
"""dB by which a held-out photo is worse than the median before it is named."""

WIDE_GAP = 8.0
"""dB between training photos and held-out photos, above which a scene is learned by heart."""

MAX_NAMES = 5


@dataclass(frozen=True)
class Notice:
    """Something that stands out, and what may be done about it."""

    what: str
    advice: str = ""


@dataclass(frozen=True)
class NoticeInputs:
    """What notices are made of."""

    cost: Cost
    reasons: Sequence[EffectReason]
    photos: Sequence[TrainingPhoto]
    results: Mapping[str, Any]
    """Of the evaluation; empty without one."""
    failure: str | None = None
    """What `failure_case` found."""
    judges_by_others: bool = False
    """Whether distractors start where a photo shows what the others do not."""


def notices(inputs: NoticeInputs) -> list[Notice]:
    """Everything that stands out, what matters most first."""
    found = [
        _failure(inputs),
        _unfinished(inputs.cost),
        _few_photos(inputs),
        _much_covered(inputs.photos),
        _nothing_covered(inputs.photos),
        _outliers(inputs.results),
        _gap(inputs),
        *_unsure(inputs.reasons),
        _short(inputs.cost),
    ]
    return [one for one in found if one is not None]


def _failure(inputs: NoticeInputs) -> Notice | None:
    if inputs.failure is None:
        return None
    what, _, advice = inputs.failure.partition(". ")
    return Notice(f"{what[0].upper()}{what[1:]}.", advice)


def _unfinished(cost: Cost) -> Notice | None:
    if cost.steps >= cost.planned:
        return None
    return Notice(
        f"The run has {cost.steps:,} of {cost.planned:,} steps: it was stopped, or this is one of "
        "its earlier checkpoints.",
        "Go on with --load-dir and the folder of its checkpoints.",
    )


def _few_photos(inputs: NoticeInputs) -> Notice | None:
    if not inputs.judges_by_others or inputs.cost.num_photos >= FEW_VIEWS:
        return None
    return Notice(about_few_views(inputs.cost.num_photos))


def _much_covered(photos: Sequence[TrainingPhoto]) -> Notice | None:
    names = [one.name for one in photos if one.covered is not None and one.covered > MUCH]
    if not names:
        return None
    return Notice(
        f"Distractors cover more than half of {list_names(names, MAX_NAMES)}.",
        "Look at them below. A photo that shows little of the scene can be left out of the "
        "capture; if what is covered belongs to the scene, try a higher "
        "--pipeline.model.distractors.strong-excess.",
    )


def _nothing_covered(photos: Sequence[TrainingPhoto]) -> Notice | None:
    shares = [one.covered for one in photos if one.covered is not None]
    if not shares or statistics.fmean(shares) > HARDLY:
        return None
    return Notice(
        "Distractors cover next to nothing: either nothing is in the way, or it was not found.",
        "If you see nothing in the way, --pipeline.model.effects.distractors False is as good or "
        "better, and faster. If you do: more steps, or a lower "
        "--pipeline.model.distractors.strong-excess.",
    )


def _outliers(results: Mapping[str, Any]) -> Notice | None:
    scores = {one["name"]: one["psnr"] for one in results.get("images", ()) if "psnr" in one}
    if len(scores) < 3:
        return None
    median = statistics.median(scores.values())
    order = sorted(scores, key=lambda name: scores[name])
    low = [name for name in order if scores[name] < median - FAR_BELOW]
    if not low:
        return None
    return Notice(
        f"Held out and far worse than the others ({median:.1f} dB): {list_names(low, MAX_NAMES)}.",
        "Look at their error maps. Bright everywhere: the pose or the light of the photo is off. "
        "Bright in one place: something is in the way there, or no training photo shows it.",
    )


def _gap(inputs: NoticeInputs) -> Notice | None:
    held_out, ours = inputs.results.get("psnr"), [one.psnr for one in inputs.photos]
    if held_out is None or not ours or statistics.fmean(ours) - held_out < WIDE_GAP:
        return None
    return Notice(
        f"Training photos are explained at {statistics.fmean(ours):.1f} dB, held-out photos at "
        f"{held_out:.1f} dB: views between the photos are much worse than the photos.",
        "More photos help most. With few of them, --pipeline.model.photos-per-coefficient 2 may.",
    )


def _unsure(reasons: Sequence[EffectReason]) -> list[Notice]:
    return [
        Notice(
            f"The survey was not sure about {one.effect} ({one.value}).",
            f"Compare with a run that has another --pipeline.model.effects.{one.effect}.",
        )
        for one in reasons
        if one.is_unsure
    ]


def _short(cost: Cost) -> Notice | None:
    if cost.visits >= BEST_VISITS or cost.steps >= LONG:
        return None
    most = BEST_VISITS * cost.num_photos
    return Notice(
        f"Each photo was seen {cost.visits:.0f} times.",
        "More steps may still help: desplat-best, or a larger --max-num-iterations. After "
        f"{most:,} nothing more was gained on the captures that it was measured on.",
    )
