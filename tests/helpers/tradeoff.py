"""A study of a made-up capture, and records of trainings that nobody did."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from desplat_ns.errors import DeSplatError
from desplat_ns.settings.effects import Effects
from desplat_ns.studies.capture_info import CaptureInfo
from desplat_ns.studies.executors import Keep
from desplat_ns.studies.runs import Record, Run

CAPTURE = CaptureInfo("/photos/garden", ("colmap",), 20, 3, 120, 80, 500, Effects())

Outcome = Callable[[Run], Record | Exception]


def made_up(run: Run) -> Record:
    """A record: more dB with more steps, a little by setting and seed, a tenth of a second each
    step."""
    extra = sum(map(ord, run.variant.name)) % 7 / 10 + (run.seed - 43) / 100
    curve = tuple(
        {"step": done, "psnr": 10 + done / 100, "train_wall_seconds": done / 10}
        for done in (run.steps // 2, run.steps)
    )
    figures = {
        "psnr": 10 + run.steps / 100 + extra,
        "ssim": 0.5,
        "train_wall_seconds": run.steps / 10,
        "train_cpu_seconds": run.steps / 10,
        "num_static_gaussians": 1000,
        "run_wall_seconds": 5 + run.steps / 10,
    }
    return Record(figures, "c0ffee", "cpu", "numba", curve)


@dataclass
class MadeUpExecutor:
    """Does runs without doing them, and tells the clock how long they took."""

    pass_time: Callable[[float], None]
    outcome: Outcome = made_up
    done: list[Run] = field(default_factory=list)

    def do(self, runs: Iterable[Run], folder: Path, keep: Keep) -> list[bool]:
        """See `Executor`."""
        kept = []
        for run in runs:
            self.done.append(run)
            self.pass_time(5 + run.steps / 10)
            kept.append(keep(run, self.outcome(run)))
        return kept


def failing(name: str) -> Outcome:
    """As `made_up`, but for the runs whose names begin so."""

    def outcome(run: Run) -> Record | Exception:
        return DeSplatError("too dark") if run.name.startswith(name) else made_up(run)

    return outcome
