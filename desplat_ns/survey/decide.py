"""From a survey to the effects of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.console import announce
from desplat_ns.settings.effects import Effects, EffectsConfig
from desplat_ns.survey.capture import capture_of
from desplat_ns.survey.findings import Survey
from desplat_ns.survey.survey import survey

FILE = "survey.json"
"""In a run's folder: what its effects were decided by."""


def decided_effects(
    effects: EffectsConfig, outputs: DataparserOutputs
) -> tuple[EffectsConfig, Survey]:
    """The effects that the training photos call for, where `effects` does not give them, and the
    findings, which are said on the console.

    Args:
        outputs: of the training split.

    Raises:
        CaptureError: no photo, or one that cannot be read or does not fit its camera.
    """
    found, _ = survey(capture_of(outputs))
    decided = effects.decided(effects_of(found))
    for line in found.summary():
        announce(line)
    given = {name: value for name, value in vars(effects).items() if value is not None}
    for name, value in found.decisions().items():
        if name in given and given[name] != value:
            announce(f"{name}: {given[name]}, as given; the survey would have said {value}.")
    return decided, found


def write_findings(found: Survey, folder: Path) -> None:
    """Write `FILE` into a folder, which is made; where that cannot be done, it is said."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / FILE).write_text(found.to_json(), "utf8")
    except OSError as error:
        announce(f"The survey's findings could not be written ({error}).", warning=True)


def effects_of(found: Survey) -> Effects:
    """What a survey decided."""
    decisions: dict[str, Any] = found.decisions()
    return Effects(**decisions)
