"""What a large capture costs: survey, budget, the first steps of a training, a report.

    python -m lab.performance.large_captures CAPTURE PART STEPS [OPTION_OF_NS_TRAIN ...]

PART is survey, budget, training or report; each is a process of its own, which prints its seconds
and its peak of memory. `training` ends after STEPS steps of a run of the method's own length, when
photos are a quarter of their size; `report` makes a page of it. Captures:
`lab.synthetic.many_photos`.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

BEGAN = time.time()  # before anything large is imported

from desplat_ns.studies.methods import parse  # noqa: E402
from lab.pixels.memory import status_mib  # noqa: E402

Figures = dict[str, float]


def since_start() -> float:
    """Seconds since this process began."""
    return time.time() - BEGAN


def survey_of(config: Any, _: int) -> Figures:
    from desplat_ns.datamanager import training_split
    from desplat_ns.survey.observations import capture_of
    from desplat_ns.survey.survey import survey

    outputs = training_split(config.pipeline.datamanager)
    parsed = since_start()
    survey(capture_of(outputs))
    return {"until_parsed": parsed, "survey": since_start() - parsed}


def budget_of(config: Any, _: int) -> Figures:
    from desplat_ns.datamanager import training_split

    config.budget = "20min"
    config.pipeline.model.effects.auto = False
    before = since_start()
    capture = partial(training_split, config.pipeline.datamanager)
    run = config.plan_budget(None, capture, time.monotonic())
    return {"budget": since_start() - before, "planned_steps": float(run.state.steps)}


def training_of(config: Any, steps: int) -> Figures:
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    set_up, seconds, iteration = since_start(), [], trainer.train_iteration

    def timed(step: int) -> Any:
        began = time.perf_counter()
        result = iteration(step)
        seconds.append(time.perf_counter() - began)
        if step == 0:
            seconds.append(since_start())
        trainer.stop_training = step + 1 >= steps
        return result

    trainer.train_iteration = timed
    trainer.train()
    first, until_first, *others = seconds
    return {
        "until_set_up": set_up,
        "first_step": first,
        "until_first_step_done": until_first,
        "a_step_median": median(others),
        "a_step_mean": sum(others) / len(others),
    }


def report_of(config: Any, _: int) -> Figures:
    from desplat_ns.report.report import write_report
    from desplat_ns.runs.files import find_run

    files = find_run(config.get_base_dir() / "config.yml")
    before = since_start()
    write_report(files, files.folder / "report.html", 12, 12, {}, with_scene=True)
    return {"report": since_start() - before}


PARTS: dict[str, Callable[[Any, int], Figures]] = {
    "survey": survey_of,
    "budget": budget_of,
    "training": training_of,
    "report": report_of,
}


def measure(capture: Path, part: str, steps: int, options: list[str]) -> Figures:
    """Seconds and peak of a part, run in this process."""
    output = ["--output-dir", str(capture / "runs"), "--timestamp", "run", "--vis", "tensorboard"]
    config = parse("desplat", ["--data", str(capture), *output, *options])
    config.pipeline.datamanager.data = config.data
    config.machine.device_type = "cpu"
    figures = PARTS[part](config, steps)
    peak = status_mib("VmHWM") * 2**20 / 1e9
    return {**figures, "cpu": time.process_time(), "peak_gigabytes": peak}


if __name__ == "__main__":
    folder, of_part, number, *rest = sys.argv[1:]
    figures = measure(Path(folder), of_part, int(number), rest)
    print(json.dumps({of_part: {name: round(value, 3) for name, value in figures.items()}}))
