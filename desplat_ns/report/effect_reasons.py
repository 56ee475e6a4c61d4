"""Which effects a run had, and why: what the training found and the survey decided."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from desplat_ns.console import list_names
from desplat_ns.settings.effects import Effects

TITLES = {
    "distractors": "Distractors: what is in the way in one photo only",
    "appearance": "Appearance: a light of each photo's own",
    "background": "Background: what lies behind everything, as the sky",
}
"""The effects in their order, in words."""

SURVEYED = ("appearance", "background")
"""What a survey decides."""

MAX_NAMES = 30
"""Photos with something in the way that are named."""

CONFIDENCE = {
    "clear": "",
    "close": " That was a close call: training with another choice may be worth a try.",
    "none": " It could not be told; this is the safe side.",
}


@dataclass(frozen=True)
class EffectReason:
    """One effect of a run."""

    effect: str
    title: str
    value: str
    """on, off, or the grade."""
    why: str
    is_unsure: bool = False
    """Whether the survey said that it was close, or that it could not tell."""
    figures: Sequence[Mapping[str, Any]] = ()
    """As `survey.findings.Figure`."""
    could_not_tell: Sequence[str] = ()


def read_survey(path: Path) -> dict[str, Any] | None:
    """A survey's findings as they were written; None if there are none that can be read."""
    try:
        findings = json.loads(path.read_text("utf8"))
    except (OSError, ValueError):
        return None
    return findings if isinstance(findings, dict) and {*SURVEYED} <= set(findings) else None


def effect_reasons(
    effects: Effects, survey: Mapping[str, Any] | None, num_photos: int, in_the_way: Sequence[str]
) -> list[EffectReason]:
    """Every effect with its reason.

    Args:
        effects: of the trained model.
        survey: as `read_survey` gives it.
        num_photos: that were trained on.
        in_the_way: names of those that have distractors.
    """
    had: dict[str, bool | str] = asdict(effects)
    why = "As given."
    if had["distractors"]:
        why = f"In none of {num_photos:,} photos: nothing was found in the way."
        if in_the_way:
            names = list_names(in_the_way, MAX_NAMES)
            why = f"In {len(in_the_way):,} of {num_photos:,} photos: {names}."
    value = in_words(had["distractors"])
    first = EffectReason("distractors", TITLES["distractors"], value, why)
    if survey is not None:
        return [first, *(_surveyed(name, had[name], survey[name]) for name in SURVEYED)]
    why = (
        "As given, the method's default, or as in the run that this one goes on with: there is "
        "no record of a survey of the photos."
    )
    return [first, *(EffectReason(k, TITLES[k], in_words(had[k]), why) for k in SURVEYED)]


def in_words(value: bool | str) -> str:
    """An effect's switch: on, off, or its grade."""
    return value if isinstance(value, str) else "on" if value else "off"


def _surveyed(effect: str, had: bool | str, finding: Mapping[str, Any]) -> EffectReason:
    decision, confidence, reason = (finding[key] for key in ("decision", "confidence", "reason"))
    why = reason + CONFIDENCE[confidence]
    if decision != had:
        would = in_words(decision)
        why = f"As given. The survey of the photos would have said {would}: {reason}"
    return EffectReason(
        effect,
        TITLES[effect],
        in_words(had),
        why,
        decision == had and confidence in ("close", "none"),
        finding.get("figures", ()),
        finding.get("could_not_tell", ()),
    )
