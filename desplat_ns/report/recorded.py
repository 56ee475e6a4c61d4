"""What a run recorded: its curves, what it cost, and which effects it had for which reason."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from desplat_ns.console import list_names
from desplat_ns.evaluation.evaluate import gaussian_counts
from desplat_ns.runs.loading import LoadedRun
from desplat_ns.settings.effects import Effects

if TYPE_CHECKING:
    from tensorboard.backend.event_processing.event_accumulator import ScalarEvent

# --- curves ----------------------------------------------------------------------------------

Points = tuple[tuple[float, float], ...]
"""(step, value), in the order of the steps."""

MOST_POINTS = 240
"""Of a curve; if there are more, neighbours are averaged."""

TOTAL_TIME = "Train Total (time)"
"""Seconds of the training loop, logged at its end."""

HELD_OUT = "Eval Images Metrics Dict (all images)/psnr"

CHARTS: tuple[tuple[str, Mapping[str, str], bool], ...] = (
    ("Loss, on a logarithmic scale", {"Train Loss": "what training makes small"}, True),
    (
        "PSNR, dB",
        {
            "Train Metrics Dict/psnr": "training photos, with their distractors",
            HELD_OUT: "held-out photos, by the static scene alone",
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


class History(NamedTuple):
    """What a run logged while it trained."""

    charts: tuple[Chart, ...]
    seconds: float | None
    """Of training, all sessions together; None if nothing was logged."""


def read_history(files: Sequence[Path]) -> History:
    """The charts of a run and how long it took, from its event files, oldest first. If a run went
    on from an earlier checkpoint, the last value of a step counts."""
    tags = {tag for _, names, _ in CHARTS for tag in names} | {TOTAL_TIME}
    values: dict[str, dict[int, float]] = {tag: {} for tag in tags}
    seconds = []
    for path in files:
        by_tag = scalars(path, tags)
        for tag, logged in by_tag.items():
            values[tag].update({event.step: event.value for event in logged})
        if TOTAL_TIME in by_tag:
            seconds.append(by_tag[TOTAL_TIME][-1].value)
        elif by_tag:  # the session was killed
            times = [event.wall_time for logged in by_tag.values() for event in logged]
            seconds.append(max(times) - min(times))
    charts = []
    for title, names, is_logarithmic in CHARTS:
        curves = {name: thinned(values[tag], is_logarithmic) for tag, name in names.items()}
        curves = {name: points for name, points in curves.items() if points}
        charts += [Chart(title, curves, is_logarithmic)] if curves else []
    return History(tuple(charts), sum(seconds) if seconds else None)


def scalars(path: Path, tags: Collection[str]) -> dict[str, Sequence[ScalarEvent]]:
    """The numbers of an event file by tag, in the order in which they were logged, up to where the
    file is cut off or damaged; empty if it cannot be read."""
    from tensorboard.backend.event_processing import event_accumulator  # half a second

    all_of_them = {event_accumulator.SCALARS: 0}
    events = event_accumulator.EventAccumulator(str(path), all_of_them, purge_orphaned_data=False)
    try:
        events.Reload()
    except OSError:
        return {}
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


# --- cost ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Cost:
    """A run in numbers."""

    experiment: str
    method: str
    capture: str
    """The folder that was trained on."""
    steps: int
    """Done."""
    planned: int
    num_photos: int
    """Training photos."""
    seconds: float | None
    """Of training; None if the run did not record it."""
    budget: str
    """Wall time that the run was given; empty if none."""
    num_static: int
    num_distractors: int
    parameter_mb: float
    """10^6 bytes of the Gaussians' parameters."""
    trained_on: str
    """The device, in words."""

    @property
    def visits(self) -> float:
        """How often each photo was seen."""
        return self.steps / self.num_photos


def cost_of(run: LoadedRun, seconds: float | None) -> Cost:
    """What a run cost; `seconds`: of training, if that was logged."""
    config, pipeline = run.config, run.pipeline
    device = config.machine.device_type
    counts = gaussian_counts(pipeline.model.gauss_params, pipeline.model.distractors)
    capture = config.pipeline.datamanager.data
    return Cost(
        experiment=str(config.experiment_name),
        method=str(config.method_name),
        capture="" if capture is None else from_here(capture),
        steps=run.steps,
        planned=config.max_num_iterations,
        num_photos=len(pipeline.datamanager.train_image_names),
        seconds=seconds,
        budget=config.budget,
        num_static=int(counts["num_static_gaussians"]),
        num_distractors=int(counts["num_distractor_gaussians"]),
        parameter_mb=counts["static_memory_mb"] + counts["distractor_memory_mb"],
        trained_on={"cuda": "a GPU", "cpu": "the CPU"}.get(device, device),
    )


def from_here(path: Path) -> str:
    """A path as somebody types it in the working folder if it lies below it: then a page that is
    sent to others does not name the folders of this machine."""
    inside, here = path.absolute(), Path.cwd()
    return str(inside.relative_to(here) if inside.is_relative_to(here) else path)


# --- effects ---------------------------------------------------------------------------------

TITLES = {
    "distractors": "Distractors: what is in the way in one photo only",
    "appearance": "Appearance: a light of each photo's own",
    "background": "Background: what lies behind everything, as the sky",
}
SURVEYED = ("appearance", "background")
"""Effects that a survey decides."""

MAX_NAMES = 30
"""Photos with distractors that are named."""

CONFIDENCE = {
    "clear": "",
    "close": " That was a close call: training with another choice may be worth a try.",
    "none": " It could not be told; this is the safe side.",
}
NO_SURVEY = (
    "As given, the method's default, or as in the run that this one goes on with: there is no "
    "record of a survey of the photos."
)


class EffectReason(NamedTuple):
    """One effect of a run."""

    effect: str
    value: str
    """on, off, or the grade."""
    why: str
    is_unsure: bool = False
    """Whether the survey said that it was close, or that it could not tell."""

    @property
    def title(self) -> str:
        """What the effect is, in words."""
        return TITLES[self.effect]


def read_survey(path: Path) -> dict[str, Any] | None:
    """A survey's findings as they were written; None if there are none that can be read."""
    try:
        findings = json.loads(path.read_text("utf8"))
        told = [findings[effect] for effect in SURVEYED]
        is_whole = all(type(each[key]) is str for each in told for key in ("decision", "reason"))
        return findings if is_whole and all(e["confidence"] in CONFIDENCE for e in told) else None
    except (OSError, ValueError, KeyError, TypeError):
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
    names = list_names(in_the_way, MAX_NAMES) or "nothing was found in the way"
    found = f"In {len(in_the_way):,} of {num_photos:,} photos: {names}."
    value, why = ("on", found) if effects.distractors else ("off", "As given.")
    reasons = [EffectReason("distractors", value, why)]
    for effect in SURVEYED:
        grade = getattr(effects, effect)
        if survey is None:
            reasons.append(EffectReason(effect, grade, NO_SURVEY))
            continue
        finding = survey[effect]
        decision, reason = finding["decision"], finding["reason"]
        confidence = finding["confidence"] if decision == grade else "clear"
        why = reason + CONFIDENCE[confidence]
        if decision != grade:
            why = f"As given. The survey of the photos would have said {decision}: {reason}"
        reasons.append(EffectReason(effect, grade, why, confidence != "clear"))
    return reasons
