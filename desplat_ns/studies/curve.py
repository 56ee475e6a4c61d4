"""Figures on the way: what a run has reached after how much time; scoring it takes none of that."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackLocation
from nerfstudio.engine.trainer import Trainer

from desplat_ns.training.resume import restore_rng, rng_state

Point = dict[str, Any]
"""Figures by the names of the evaluation, with `step` (how many are done), `train_cpu_seconds` and
`train_wall_seconds`."""


@dataclass
class TrainingClock:
    """Seconds of training steps, of wall time and of this process's CPU time."""

    _wall: float = field(default_factory=lambda: time.perf_counter())
    _cpu: float = field(default_factory=lambda: time.process_time())

    def seconds(self) -> dict[str, float]:
        """Since it was made, without pauses."""
        return {
            "train_cpu_seconds": round(time.process_time() - self._cpu, 2),
            "train_wall_seconds": round(time.perf_counter() - self._wall, 2),
        }

    @contextmanager
    def paused(self) -> Iterator[None]:
        """What happens within takes no time."""
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self._wall += time.perf_counter() - wall
            self._cpu += time.process_time() - cpu


def scored_steps(steps: int, evaluations: int) -> list[int]:
    """How many steps are done when a run is scored: all, half of them, a quarter, and so on.

    Args:
        evaluations: of the run, the last one included; fewer come back where steps are few.
    """
    return sorted({steps >> halvings for halvings in range(evaluations)} - {0})


class Curve:
    """Scores a run on its way, and leaves its random generators as they were."""

    def __init__(
        self, clock: TrainingClock, score: Callable[[], dict[str, Any]], steps: list[int]
    ) -> None:
        """Args:
        score: the figures of the model as it stands.
        steps: after how many it is scored; the last is the run's end, which is timed alone.
        """
        self.points: list[Point] = []
        self.seconds: dict[str, float] = {}
        """Of the whole run, once its last step is done: what is saved after it is not in them."""
        self._clock, self._score, self._steps = clock, score, steps

    def attach(self, trainer: Trainer) -> None:
        """Score the run of a trainer that is set up."""
        callback = TrainingCallback(
            [TrainingCallbackLocation.AFTER_TRAIN_ITERATION],
            self._after_step,
            iters=tuple(done - 1 for done in self._steps),
        )
        trainer.callbacks.append(callback)

    def _after_step(self, step: int) -> None:
        seconds = self._clock.seconds()
        if step + 1 == self._steps[-1]:
            self.seconds = seconds
            return
        with self._clock.paused():
            randomness = rng_state()
            figures = self._score()
            restore_rng(randomness)
        self.points.append({"step": step + 1, **seconds, **figures})
