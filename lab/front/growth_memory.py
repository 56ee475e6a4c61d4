"""Peak memory of building and training a model of one size, in a process of its own.

python -m lab.front.growth_memory SIZE        prints MiB, or n/a; SIZE as JSON
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict

from desplat_ns.studies.runs import ONE_THREAD
from lab.front.whole_step import Size, WholeStep
from lab.pixels.memory import answer, answer_of, peak_mib

TINY = Size(2, 200, 64, 48, 20)
"""What pays for imports, compilation and thread pools."""


def measure_peak(size: Size, like: Size | None) -> float | None:
    """MiB above what the process held before, with one thread.

    The model, its optimizers and one photo are in it, and a round of steps. None where the
    system does not tell (no Linux /proc).

    Args:
        like: see `WholeStep`.
    """
    texts = [json.dumps(None if scene is None else asdict(scene)) for scene in (size, like)]
    return answer_of("lab.front.growth_memory", *texts, **ONE_THREAD)


def train(size: Size, like: Size | None) -> None:
    """Build the model, and draw every view; then some once more."""
    step = WholeStep(size, like)
    for _ in range(3):
        step()


def main(texts: list[str]) -> None:
    """Entry point."""
    size, like = (None if fields is None else Size(**fields) for fields in map(json.loads, texts))
    assert size is not None
    train(TINY, None)
    answer(lambda: peak_mib(lambda: train(size, like)))


if __name__ == "__main__":
    main(sys.argv[1:])
