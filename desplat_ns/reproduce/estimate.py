"""What a table takes before it is begun: time on this machine, room on the disk."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from desplat_ns.calibration.run_plan import expected_gaussians, measure_costs
from desplat_ns.reproduce.scenes import Content, FoundScene, outputs_of
from desplat_ns.settings.effects import Effects
from desplat_ns.studies.methods import parse
from desplat_ns.studies.runs import Run

BYTES_OF_A_GAUSSIAN = 59 * 4 * 3
"""Its numbers with spherical harmonics of degree 3, each with Adam's two moments."""

CHECKPOINTS = 2
"""That a run keeps while it trains; they are removed once it is scored."""


def expected_seconds(scene: FoundScene, runs: Sequence[Run], device: str) -> float | None:
    """Wall time of the steps of runs, one after another, by steps timed on generated Gaussians.

    Args:
        scene: stands for all; its photos' number and size count.

    Returns:
        None where a method is none of this package's, whose steps are not known.
    """
    outputs, total, a_step = outputs_of(scene, "train"), 0.0, {}
    for run in runs:
        key = (run.variant.method, run.variant.options)
        if key not in a_step:
            config = parse(run.variant.method, list(run.variant.options))
            model = config.pipeline.model
            if not hasattr(model, "effects"):
                return None
            model.effects = model.effects.decided(Effects())
            cost = measure_costs(outputs, model, device)
            a_step[key] = cost.mean(model, len(outputs.cameras), config.nominal_num_iterations)
        total += run.steps * a_step[key]
    return total


def expected_bytes(
    contents: Iterable[tuple[Content, int]], largest: FoundScene, jobs: int, device: str
) -> int:
    """What runs leave on the disk, and take while they train, at most: pictures are counted as if
    PNG did not make them smaller.

    Args:
        contents: of each scene, with the number of its runs.
        largest: the scene with the most pixels.
    """
    model = parse("desplat-paper", []).pipeline.model
    gaussians = expected_gaussians(outputs_of(largest, "train"), model, device)
    pictures = sum(2 * 3 * c.held_out * c.width * c.height * runs for c, runs in contents)
    return pictures + jobs * CHECKPOINTS * BYTES_OF_A_GAUSSIAN * gaussians
