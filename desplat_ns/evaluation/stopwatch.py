"""Wall-clock time of a piece of work on any device."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import torch


@dataclass
class Stopwatch:
    """Wall-clock seconds; waits for the GPU where there is one."""

    device: torch.device
    _start: float = field(default=0.0)

    def start(self) -> None:
        """Begin at zero."""
        self._start = self._now()

    def seconds(self) -> float:
        """Since `start`."""
        return self._now() - self._start

    def _now(self) -> float:
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        return time.perf_counter()
