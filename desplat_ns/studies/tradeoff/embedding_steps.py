"""Score a trained run with several numbers of steps for a held-out photo's embedding.

python -m desplat_ns.studies.tradeoff.embedding_steps CONFIG.yml RESULTS.json STEPS...
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from desplat_ns.runs.files import find_run
from desplat_ns.runs.loading import load_run
from desplat_ns.studies.grid.train_and_score import end_with


def figures_by_steps(config: Path, steps: list[int]) -> dict[int, dict[str, Any]]:
    """What `ns-eval` gives, for each number of steps.

    Args:
        config: config.yml of a run whose photos have an embedding.
    """
    pipeline = load_run(find_run(config)).pipeline
    figures = {}
    for number in steps:
        pipeline.config.evaluation = replace(pipeline.config.evaluation, steps=number)
        figures[number] = pipeline.get_average_eval_image_metrics(get_std=True)
    return figures


def main() -> None:
    """Entry point."""
    end_with(os.getppid())
    config, target, *steps = sys.argv[1:]
    figures = figures_by_steps(Path(config), [int(number) for number in steps])
    Path(target).write_text(json.dumps(figures))


if __name__ == "__main__":
    main()
