"""Which effects a run had, and for which reason."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from desplat_ns.console import list_names
from desplat_ns.settings.effects import Effects

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
