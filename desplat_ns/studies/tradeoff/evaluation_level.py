"""What more care in evaluation buys: steps for a held-out photo's embedding, by grade of light."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.studies.grid.commands import run_command
from desplat_ns.studies.grid.execute import config_of
from desplat_ns.studies.grid.records import Records
from desplat_ns.studies.grid.runs import Run, Study
from desplat_ns.studies.tradeoff.plan import SCENE, SEEDS, Compared

PROGRAM = "desplat_ns.studies.tradeoff.embedding_steps"

STEPS = (0, 8, 32, 128, 512)
"""Of Adam, for an embedding. B.3 has 128."""


@dataclass(frozen=True)
class Score:
    """A trained run, scored in one way."""

    setting: str
    steps: int | None
    """For each embedding; None if there is none to search: no light, or one in closed form."""
    psnr: float
    """Of right halves, dB."""
    seconds_per_image: float
    """Wall time of finding its light and of rendering."""


def run_of(setting: str, steps: int) -> Run:
    """The training that is scored: of the comparison's length, with the first seed."""
    return Run(setting, SCENE, 1, steps, SEEDS[0])


def with_embeddings(compared: Mapping[str, Compared]) -> list[str]:
    """Names of the settings whose photos have an embedding to search."""
    return [name for name, one in compared.items() if one.effects.image_embeddings]


def scores_as_trained(names: list[str], steps: int, records: Records) -> list[Score]:
    """Scores of settings without anything to search, from their records.

    Args:
        steps: of a run of the comparison.
    """
    found = {name: records.get(run_of(name, steps).name) for name in names}
    return [
        _score(name, None, record.figures) for name, record in found.items() if record is not None
    ]


def steps_in(seconds: float, a_step: float) -> tuple[int, ...]:
    """The first of `STEPS` that can all be taken in a time.

    Args:
        a_step: seconds of a step, for all photos together.
    """
    number = len(STEPS)
    while number > 0 and sum(STEPS[:number]) * a_step > seconds:
        number -= 1
    return STEPS[:number]


def scores_by_steps(
    study: Study, setting: str, steps: int, folder: Path, numbers: Sequence[int]
) -> list[Score]:
    """Scores of a run with several numbers of steps, in a process of its own.

    Args:
        steps: of a run of the comparison.
        folder: of what is trained.
        numbers: some of `STEPS`.

    Raises:
        DeSplatError: it failed; the message names its log.
    """
    run = run_of(setting, steps)
    target = folder / run.name / "embedding_steps.json"
    line = ["python", "-m", PROGRAM, config_of(study, run, folder), target, *numbers]
    run_command(line, target.with_suffix(".log"))
    found: dict[str, Any] = json.loads(target.read_text("utf8"))
    return [_score(setting, int(number), figures) for number, figures in found.items()]


def _score(setting: str, steps: int | None, figures: Mapping[str, Any]) -> Score:
    seconds = figures["seconds_per_image_render"] + figures.get("embedding_seconds", 0.0)
    return Score(setting, steps, float(figures["psnr"]), round(float(seconds), 4))
