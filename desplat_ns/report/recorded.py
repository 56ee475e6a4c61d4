"""What a run recorded: its curves, its numbers, and which effects it had for which reason."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from desplat_ns.console import list_names
from desplat_ns.evaluation.evaluate import gaussian_counts
from desplat_ns.runs.loading import LoadedRun
from desplat_ns.settings.effects import Effects

# --- curves ----------------------------------------------------------------------------------

Points = tuple[tuple[float, float], ...]
"""(step, value), in the order of the steps."""

MOST_POINTS = 240
"""Of a curve; if there are more, neighbours are averaged."""

CHARTS: tuple[tuple[str, Mapping[str, str], bool], ...] = (
    ("Loss, on a logarithmic scale", {"Train Loss": "what training makes small"}, True),
    (
        "PSNR, dB",
        {
            "Train Metrics Dict/psnr": "training photos, with their distractors",
            "Eval Images Metrics Dict (all images)/psnr": "held-out photos, by the static scene",
        },
        False,
    ),
    (
        "Number of Gaussians",
        {
            "Train Metrics Dict/gaussian_count": "static",
            "Train Metrics Dict/distractor_count": "distractors of all photos",
        },
        False,
    ),
)
"""Title, tags with the names of their curves, whether the scale is logarithmic."""


class Chart(NamedTuple):
    """Curves that share their axes, by name."""

    title: str
    curves: Mapping[str, Points]
    is_logarithmic: bool = False


def read_history(files: Sequence[Path]) -> tuple[list[Chart], float | None]:
    """The charts of a run, and the seconds of its sessions from the first to the last entry; None
    if nothing was logged. The files are its event files, oldest first: if a run went on from an
    earlier checkpoint, the last value of a step counts."""
    tags = {tag for _, names, _ in CHARTS for tag in names}
    values: dict[str, dict[int, float]] = {tag: {} for tag in tags}
    seconds = []
    for path in files:
        by_tag = scalars(path, tags)
        for tag, logged in by_tag.items():
            values[tag].update({event.step: event.value for event in logged})
        if times := [event.wall_time for logged in by_tag.values() for event in logged]:
            seconds.append(max(times) - min(times))
    charts = []
    for title, names, is_logarithmic in CHARTS:
        curves = {name: thinned(values[tag], is_logarithmic) for tag, name in names.items()}
        curves = {name: points for name, points in curves.items() if points}
        charts += [Chart(title, curves, is_logarithmic)] if curves else []
    return charts, sum(seconds) if seconds else None


def scalars(path: Path, tags: Collection[str]) -> dict[str, list[Any]]:
    """TensorBoard's `ScalarEvent`s of a file by tag, in the order in which they were logged, up to
    where the file is cut off or damaged."""
    from tensorboard.backend.event_processing import event_accumulator  # half a second

    all_of_them = {event_accumulator.SCALARS: 0}
    events = event_accumulator.EventAccumulator(str(path), all_of_them, purge_orphaned_data=False)
    events.Reload()
    return {tag: events.Scalars(tag) for tag in events.Tags()["scalars"] if tag in tags}


def thinned(
    values: Mapping[int, float], is_logarithmic: bool = False, most: int = MOST_POINTS
) -> Points:
    """At most `most` points of values by step, means of neighbours where there are more; without
    what is not finite, and on a logarithmic scale what is not positive."""
    least = 0 if is_logarithmic else -math.inf
    points = np.array([(step, v) for step, v in sorted(values.items()) if least < v < math.inf])
    size = math.ceil(len(points) / most) or 1
    groups = (points[start : start + size] for start in range(0, len(points), size))
    return tuple((float(step), float(value)) for step, value in (g.mean(axis=0) for g in groups))


# --- numbers ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Numbers:
    """A run in names and numbers."""

    experiment: str
    method: str
    capture: str
    """The folder that was trained on."""
    steps: int
    """Done."""
    planned: int
    has_budget: bool
    """Whether its end was set by the clock."""
    num_photos: int
    """Training photos."""
    seconds: float | None
    """Of training; None if the run did not record it."""
    num_static: int
    num_distractors: int


def numbers_of(run: LoadedRun, seconds: float | None) -> Numbers:
    """A run in numbers; `seconds`: of training, if that was logged."""
    config, pipeline = run.config, run.pipeline
    counts = gaussian_counts(pipeline.model.gauss_params, pipeline.model.distractors)
    return Numbers(
        experiment=str(config.experiment_name),
        method=str(config.method_name),
        capture=str(config.pipeline.datamanager.data or ""),
        steps=run.steps,
        planned=config.max_num_iterations,
        has_budget=bool(config.budget),
        num_photos=len(pipeline.datamanager.train_image_names),
        seconds=seconds,
        num_static=int(counts["num_static_gaussians"]),
        num_distractors=int(counts["num_distractor_gaussians"]),
    )


# --- effects ---------------------------------------------------------------------------------

SURVEYED = {
    "appearance": "Appearance: a light of each photo's own",
    "background": "Background: what lies behind everything, as the sky",
}
"""What the effects are that a survey decides, in words."""

CONFIDENCE = {
    "clear": "",
    "close": " That was a close call: training with another choice may be worth a try.",
    "none": " It could not be told; this is the safe side.",
}
NO_SURVEY = "As given, or the method's default: there is no record of a survey of the photos."


class EffectReason(NamedTuple):
    """One effect of a run."""

    title: str
    """What the effect is, in words."""
    value: str
    """on, off, or the grade."""
    why: str


def read_survey(path: Path) -> dict[str, Any] | None:
    """A survey's findings as they were written; None if there are none that can be read."""
    try:
        return json.loads(path.read_text("utf8"))
    except (OSError, ValueError):
        return None


def effect_reasons(
    effects: Effects, survey: Mapping[str, Any] | None, num_photos: int, in_the_way: Sequence[str]
) -> list[EffectReason]:
    """Every effect of the trained model with its reason.

    Args:
        survey: as `read_survey` gives it.
        num_photos: training photos.
        in_the_way: names of the training photos that have distractors.
    """
    names = list_names(in_the_way) or "nothing was found in the way"
    found = f"In {len(in_the_way):,} of {num_photos:,} photos: {names}."
    value, why = ("on", found) if effects.distractors else ("off", "As given.")
    reasons = [EffectReason("Distractors: what is in the way in one photo only", value, why)]
    for effect, title in SURVEYED.items():
        grade, why = getattr(effects, effect), NO_SURVEY
        if survey is not None:
            finding = survey[effect]
            why = finding["reason"] + CONFIDENCE[finding["confidence"]]
            if finding["decision"] != grade:
                said = f"{finding['decision']}: {finding['reason']}"
                why = f"As given. The survey of the photos would have said {said}"
        reasons.append(EffectReason(title, grade, why))
    return reasons
