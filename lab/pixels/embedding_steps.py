"""What more care in evaluation buys: a trained run, scored with several numbers of steps for a
held-out photo's embedding."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from desplat_ns.runs.files import find_run
from desplat_ns.runs.loading import load_run

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


def scores(config: Path, setting: str, steps: Sequence[int] = STEPS) -> Iterator[Score]:
    """A score for each number of steps.

    Args:
        config: config.yml of a run whose photos have an embedding.
        setting: what the run is called in the table.
    """
    pipeline = load_run(find_run(config)).pipeline
    for number in steps:
        pipeline.config.evaluation = replace(pipeline.config.evaluation, steps=number)
        figures = pipeline.get_average_eval_image_metrics(get_std=True)
        seconds = figures["seconds_per_image_render"] + figures.get("embedding_seconds", 0.0)
        yield Score(setting, number, float(figures["psnr"]), round(float(seconds), 4))
