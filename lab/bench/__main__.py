"""Time every backend and a training step with each effect; print one table.

    python -m lab.bench            (or: make bench; BENCH_ARGS='--quick' tries it out)

Gaussians are generated (`lab/bench/scenes.py`). Times are CPU milliseconds of the
process on one thread, wall milliseconds for what draws on a GPU: medians over all rounds, in which
the cases of a group take turns. The table goes into outputs/bench.md as well.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch

from desplat_ns.core.effects import Effects
from desplat_ns.core.whole import write_whole
from lab import OUTPUTS, markdown_table, parser_of
from lab.bench.drawing import Contender, Drawing, Errors, contenders, errors_of
from lab.bench.model_step import ModelStep
from lab.bench.scenes import Scene, make_scene
from lab.bench.timing import Timing, threads, time_in_turns
from lab.machine import describe_machine

SIZES = ((10_000, 240, 180), (20_000, 480, 270), (50_000, 1200, 800))
"""Gaussians, width and height."""
COMPARED = SIZES[1]
"""Where errors are measured: the truth takes a minute there."""
QUICK_SIZES = ((300, 64, 48),)
ROUNDS = 5

OFF = Effects(distractors=False)
STEPS: dict[str, tuple[Effects, int]] = {
    "static scene alone": (OFF, 0),
    "distractors, none in this photo": (Effects(), 0),
    "distractors, 300 in this photo": (Effects(), 300),
    **{
        f"appearance {grade}": (replace(OFF, appearance=grade), 0)
        for grade in ("camera", "affine", "sh")
    },
    **{
        f"background {grade}": (replace(OFF, background=grade), 0)
        for grade in ("constant", "sh", "image")
    },
}
"""Effects of a training step, and distractors of the photo that is drawn."""


@dataclass(frozen=True)
class Row:
    """One case of the table."""

    scene: str
    group: str
    """Cases of one group and one scene are compared with the first of them."""
    case: str
    forward_ms: float | None
    both_ms: float
    """Of forward + backward, or of a whole training step."""
    errors: Errors | None = None


def time_drawings(
    scene: Scene, runnable: Sequence[Contender], is_compared: bool, rounds: int
) -> list[Row]:
    """Every backend as the methods use it, and its errors where that is asked for."""
    drawings = {f"{c.name}, {c.device}": Drawing(c, scene) for c in runnable}
    calls: dict[str, Callable[[], None]] = {}
    for name, drawing in drawings.items():
        calls[f"{name} forward"], calls[name] = drawing.timed()
    timings, truth = time_in_turns(calls, rounds), None
    if is_compared:
        torch_cpu = next(c for c in runnable if (c.name, c.device) == ("torch", "cpu"))
        truth = Drawing(torch_cpu, scene, torch.float64).drawn()
    rows = []
    for name, drawing in drawings.items():
        forward, both = (milliseconds(timings[n], drawing) for n in (f"{name} forward", name))
        errors = None if truth is None else errors_of(drawing.drawn(), truth)
        rows.append(Row(scene.name, "backend", name, forward, both, errors))
    return rows


def milliseconds(timing: Timing, drawing: Drawing) -> float:
    """Median CPU time, or wall time where a GPU draws."""
    return timing.cpu_ms if drawing.device == "cpu" else timing.wall_ms


def time_steps(scene: Scene, rounds: int) -> list[Row]:
    """One training step of the whole model on the CPU, with one effect on at a time."""
    steps = {
        name: ModelStep(scene, effects, distractors_per_view=placed)
        for name, (effects, placed) in STEPS.items()
    }
    timings = time_in_turns(steps, rounds)
    group = "training step"
    return [Row(scene.name, group, name, None, timings[name].cpu_ms) for name in steps]


def text_of(rows: Sequence[Row], missing: dict[str, str]) -> str:
    """The rows as a Markdown table under a line on how it was made."""
    firsts: dict[tuple[str, str], float] = {}
    lines = []
    for row in rows:
        first = firsts.setdefault((row.scene, row.group), row.both_ms)
        errors = row.errors
        lines.append(
            [
                f"{row.scene}, {row.group}",
                row.case,
                "" if row.forward_ms is None else f"{row.forward_ms:.3g}",
                f"{row.both_ms:.3g}",
                f"{row.both_ms / first:.2f}",
                "" if errors is None else f"{errors.picture:.1e}",
                "" if errors is None else f"{errors.gradient:.1e} ({errors.worst})",
            ]
        )
    head = ["Gaussians @ photo", "case", "forward, ms", "with backward, ms", "over the first"]
    head += ["RMSE of colours", "error of gradients"]
    where = describe_machine()
    made = f"`make bench` at commit {where['Commit']}, {where['Date']}, on {where['Processor']}"
    absent = "".join(f"\n\nNot measured: `{name}` {reason}" for name, reason in missing.items())
    return f"{made}, torch {where['torch']}.\n\n{markdown_table(head, lines)}{absent}\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = parser_of("python -m lab.bench", __doc__)
    parser.add_argument("--quick", action="store_true", help="tiny sizes, nothing is written")
    is_quick = parser.parse_args(arguments).quick
    runnable, missing = contenders()
    sizes, rounds = (QUICK_SIZES, 1) if is_quick else (SIZES, ROUNDS)
    rows: list[Row] = []
    with threads(1):
        for size in sizes:
            scene = make_scene(*size)
            print(f"{scene.name}: rasterizers", flush=True)
            rows += time_drawings(scene, runnable, is_quick or size == COMPARED, rounds)
            print(f"{scene.name}: training steps", flush=True)
            rows += time_steps(scene, rounds)
    text = text_of(rows, missing)
    print(text)
    if not is_quick:
        OUTPUTS.mkdir(exist_ok=True)
        write_whole(OUTPUTS / "bench.md", text.encode())


if __name__ == "__main__":
    main()
