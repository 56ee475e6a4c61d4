"""What stands out in a run, and what to try, in plain words."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from desplat_ns.console import list_names
from desplat_ns.report.cost import Cost
from desplat_ns.report.effect_reasons import EffectReason
from desplat_ns.report.failure_case import Failure
from desplat_ns.report.next_photos import Alone, in_words
from desplat_ns.report.pictures import Rgb, TrainingPhoto, marked
from desplat_ns.separation.placement import FEW_VIEWS, about_few_views
from desplat_ns.training.schedule import steps_for_visits

ENOUGH_VISITS = 150.0
"""Of each photo; after these at most a decibel was gained where it was measured."""

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
    picture: Rgb | None = None
    """Where."""


def notices(
    cost: Cost,
    reasons: Sequence[EffectReason],
    photos: Sequence[TrainingPhoto],
    results: Mapping[str, Any],
    failure: Failure | None,
    judges_by_others: bool,
    alone: Sequence[Alone],
) -> list[Notice]:
    """Everything that stands out, what matters most first.

    Args:
        results: of the evaluation; empty without one.
        failure: what `failure_case` found.
        alone: photos that show parts of the scene alone.
        judges_by_others: whether distractors start where a photo shows what the others do not.
    """
    all_notices: list[Notice] = []
    if failure is not None:
        shown = [
            marked(photo.photo, failure.where)
            for photo in photos
            if photo.name == failure.name and failure.where is not None
        ]
        all_notices.append(Notice(failure.what, failure.advice, *shown))
    if cost.steps < cost.planned and not cost.budget:  # a budget ends by its clock
        all_notices.append(
            Notice(
                f"The run has {cost.steps:,} of {cost.planned:,} steps: it was stopped, or this is "
                "one of its earlier checkpoints.",
                "Go on with --load-dir and the folder of its checkpoints.",
            )
        )
    if judges_by_others and cost.num_photos < FEW_VIEWS:
        all_notices.append(Notice(about_few_views(cost.num_photos)))
    what, advice = in_words(alone)
    all_notices += [Notice(what, advice)] if what else []
    all_notices += [*_of_distractors(photos), *_of_scores(results, photos), *_unsure(reasons)]
    enough = steps_for_visits(ENOUGH_VISITS, cost.num_photos, LONG)
    if cost.steps < enough:
        all_notices.append(
            Notice(
                f"Each photo was seen {cost.visits:.0f} times.",
                "More steps may still help: a larger --max-num-iterations. After "
                f"{enough:,} at most a decibel was gained on the captures that it was measured on.",
            )
        )
    return all_notices


def _of_distractors(photos: Sequence[TrainingPhoto]) -> Iterator[Notice]:
    shares = {photo.name: photo.covered for photo in photos if photo.covered is not None}
    names = [name for name, covered in shares.items() if covered > MUCH]
    if names:
        yield Notice(
            f"Distractors cover more than half of {list_names(names, MAX_NAMES)}.",
            "Look at them below. A photo that shows little of the scene can be left out of the "
            "capture; if what is covered belongs to the scene, try a higher "
            "--pipeline.model.distractors.strong-excess.",
        )
    if shares and statistics.fmean(shares.values()) <= HARDLY:
        yield Notice(
            "Distractors cover next to nothing: either nothing is in the way, or it was not found.",
            "If you see something in the way: more steps, or a lower "
            "--pipeline.model.distractors.strong-excess.",
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


def _unsure(reasons: Sequence[EffectReason]) -> Iterator[Notice]:
    for reason in reasons:
        if reason.is_unsure:
            yield Notice(
                f"The survey was not sure about {reason.effect} ({reason.value}).",
                f"Compare with a run that has another --pipeline.model.effects.{reason.effect}.",
            )
