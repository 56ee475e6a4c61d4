"""Timing in turns: every case has its turn in every round, so that a busy spell hits all alike."""

import gc
import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

import torch

SLOW = 250.0
"""Milliseconds. A case this slow runs once a turn; others run REPEATS times, after one call that
is not counted: it finds its data in the caches, as in training, whatever ran before."""

REPEATS = 3


@dataclass
class Timing:
    """Milliseconds of every counted call."""

    cpu: list[float] = field(default_factory=list)
    """Of the whole process, all threads."""
    wall: list[float] = field(default_factory=list)

    @property
    def cpu_ms(self) -> float:
        return statistics.median(self.cpu)

    @property
    def wall_ms(self) -> float:
        return statistics.median(self.wall)

    def add(self, call: Callable[[], object]) -> None:
        """Time one call."""
        cpu, wall = time.process_time(), time.perf_counter()
        call()
        self.wall.append(1e3 * (time.perf_counter() - wall))
        self.cpu.append(1e3 * (time.process_time() - cpu))


def time_in_turns(cases: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Timing]:
    """Time all cases, `rounds` turns each, after a first call."""
    slow = set[str]()
    for name, call in cases.items():
        call()  # it may compile
        first = Timing()
        first.add(call)
        slow |= {name} if first.wall_ms > SLOW else set()
    timings = {name: Timing() for name in cases}
    gc.collect()
    gc.disable()
    try:
        for _ in range(rounds):
            for name, call in cases.items():
                if name not in slow:
                    call()
                for _ in range(1 if name in slow else REPEATS):
                    timings[name].add(call)
            gc.collect(0)  # what these calls left: nothing else is as young
    finally:
        gc.enable()
    return timings


@contextmanager
def threads(number: int) -> Iterator[None]:
    """Let torch and numba use so many threads."""
    import numba  # numba is large

    before = torch.get_num_threads(), numba.get_num_threads()
    torch.set_num_threads(number)
    numba.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before[0])
        numba.set_num_threads(before[1])
