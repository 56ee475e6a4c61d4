"""What of a training step is serial: its parts in wall time, on one core and on all.

A step of t_1 ms on one thread and t_n on n has the serial share s = (n t_n / t_1 - 1) / (n - 1):
with it s + (1 - s) / n is t_n / t_1 (Amdahl 1967), and for other numbers of threads a forecast.
A part's time is its own, without that of parts within it.
"""

from __future__ import annotations

import gc
import importlib
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

from desplat_ns.calibration.timing import Timing, threads
from desplat_ns.settings.effects import Effects
from lab.front.whole_step import Size, WholeStep

SIZES = ((20_000, 480, 270), (50_000, 1200, 800))
"""Static Gaussians, width, height."""

VIEWS, PLACED = 5, 300
"""Distractors are over the whole photo, `PLACED` of each view."""

FORECAST = (8, 16)
"""Threads."""

PARTS = {
    "desplat_ns.model:DeSplatModel.get_outputs": "drawing: colours, layers and all else",
    "desplat_ns.backend.numba_tiles:NumbaRasterizer.__call__": "drawing: projection, blending",
    "desplat_ns.backend.numba_tiles:tile_lists": "drawing: tile lists",
    "desplat_ns.model:DeSplatModel.get_loss_dict": "losses",
    "desplat_ns.separation.layer:DistractorLayer.update_regions": "search for regions",
    "desplat_ns.backend.numba_tiles:_Rasterize.backward": "gradients: blending",
    "desplat_ns.backend.numba_kernels.projection:Project.backward": "gradients: projection",
    "desplat_ns.backend.numba_kernels.sh:EvaluateColors.backward": "gradients: harmonics",
    "torch:Tensor.backward": "gradients: all else",
    "desplat_ns.training.step_guard:StepGuard.is_finite": "guard",
    "desplat_ns.training.step_guard:GuardedOptimizers.optimizer_scaler_step_some": "optimizers",
    "desplat_ns.model:DeSplatModel.step_post_backward": "after the step",
}
"""What is timed, as module:place, and what it is called."""

REST = "all else"


@dataclass(frozen=True)
class Serial:
    """One kind of step on one scene, on one thread and on more."""

    scene: str
    kind: str
    threads: int
    """The larger number."""
    whole: dict[int, Timing]
    """Uninterrupted, by number of threads."""
    parts: dict[int, dict[str, float]]
    """Wall milliseconds, medians, by number of threads."""

    @property
    def share(self) -> float:
        """Of the step that is serial."""
        return share_of(self.whole[1].wall_ms, self.whole[self.threads].wall_ms, self.threads)

    @property
    def cores_used(self) -> float:
        """CPU time over wall time, on all threads."""
        step = self.whole[self.threads]
        return step.cpu_ms / step.wall_ms


def share_of(single: float, many: float, threads: int) -> float:
    """The serial share of what takes `single` on one thread and `many` on several, in [0, 1]."""
    return min(1.0, max(0.0, (threads * many / single - 1) / (threads - 1)))


def speedup(share: float, threads: int) -> float:
    """How many times as fast on so many threads."""
    return 1 / (share + (1 - share) / threads)


class Stopwatch:
    """Own wall milliseconds of parts that lie within one another."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = defaultdict(float)
        self._open: list[str] = [REST]
        self._since = time.perf_counter()

    def lap(self) -> None:
        """What has passed belongs to the innermost part that is open."""
        now = time.perf_counter()
        self.ms[self._open[-1]] += 1e3 * (now - self._since)
        self._since = now

    def timed(self, call: Callable[..., Any], part: str) -> Callable[..., Any]:
        """`call`, as a part."""

        def within(*args: Any, **options: Any) -> Any:
            self.lap()
            self._open.append(part)
            try:
                return call(*args, **options)
            finally:
                self.lap()
                self._open.pop()

        return within

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Within, `PARTS` are timed."""
        with ExitStack() as patches:
            for place, part in PARTS.items():
                module, _, path = place.partition(":")
                *outer, name = path.split(".")
                owner = importlib.import_module(module)
                for attribute in outer:
                    owner = getattr(owner, attribute)
                timed = self.timed(getattr(owner, name), part)
                is_static = isinstance(vars(owner).get(name), staticmethod)
                patches.enter_context(
                    patch.object(owner, name, staticmethod(timed) if is_static else timed)
                )
            self._since = time.perf_counter()
            yield
            self.lap()


def parts_of(step: Callable[[], None]) -> dict[str, float]:
    """Wall milliseconds of each part of one step."""
    watch = Stopwatch()
    with watch.watching():
        step()
    return watch.ms


def time_serial(size: tuple[int, int, int], rounds: int, number: int) -> list[Serial]:
    """Time steps with and without distractors, on one thread and on `number`, in turns."""
    count, width, height = size
    of = Size(VIEWS, count, width, height, PLACED)
    off = Effects(distractors=False)
    kinds = {"desplat": WholeStep(of), "off": WholeStep(replace(of, distractors=0), effects=off)}
    scene = f"{width} x {height}, {count:,}"
    return [_timed(scene, kind, step, rounds, number) for kind, step in kinds.items()]


def _timed(scene: str, kind: str, step: WholeStep, rounds: int, number: int) -> Serial:
    numbers = (1, number)
    whole = {n: Timing() for n in numbers}
    laps: dict[int, list[dict[str, float]]] = {n: [] for n in numbers}
    gc.collect()
    gc.disable()
    try:
        for _ in range(rounds):
            for n in numbers:
                with threads(n):
                    step()  # finds its data in the caches, as in training
                    whole[n].add(step)
                    laps[n].append(parts_of(step))
            gc.collect(0)
    finally:
        gc.enable()
    names = (*dict.fromkeys(PARTS.values()), REST)
    parts = {
        n: {name: statistics.median(lap.get(name, 0.0) for lap in laps[n]) for name in names}
        for n in numbers
    }
    return Serial(scene, kind, number, whole, parts)
