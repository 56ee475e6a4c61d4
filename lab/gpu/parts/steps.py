"""How long a training step of DeSplat takes, over one of nerfstudio's Splatfacto, and the memory
that it needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import torch

from desplat_ns.calibration.scenes import make_scene
from desplat_ns.calibration.timing import Timing, time_in_turns
from lab.gpu.plan import Job
from lab.gpu.records import Figures
from lab.gpu.scenes import QUICK_SIZES, SIZES, SPLATFACTO, all_steps
from lab.gpu.spread import summary
from lab.gpu.stand_in import splatfacto_on

ROUNDS, QUICK_ROUNDS = 30, 2
"""Turns of each case; `time_in_turns` counts three steps in each."""


def measure(job: Job) -> Iterator[Figures]:
    """Milliseconds of all cases, size after size."""
    rows: list[dict[str, Any]] = []
    for size in QUICK_SIZES if job.quick else SIZES:
        scene = make_scene(*size)
        with splatfacto_on(job.device):
            cases = all_steps(job, scene)
            timings = time_in_turns(cases, QUICK_ROUNDS if job.quick else ROUNDS)
            memory = {name: peak_memory(step) for name, step in cases.items()}
        rows += [_row(scene.name, name, timings) | {"mb": memory[name]} for name in timings]
        yield {"rows": rows}


def _row(scene: str, name: str, timings: dict[str, Timing]) -> dict[str, Any]:
    """A case, and its medians' ratio to Splatfacto's."""
    wall = timings[name].wall
    ratio = timings[name].wall_ms / timings[SPLATFACTO].wall_ms
    return {"scene": scene, "case": name, "ms": summary(wall), "ratio": round(ratio, 4)}


def peak_memory(step: Callable[[], object]) -> float | None:
    """MB that a step allocates at its height beside what all cases hold; None without a GPU."""
    if not torch.cuda.is_initialized():
        return None
    torch.cuda.reset_peak_memory_stats()
    before = torch.cuda.memory_allocated()
    step()
    return (torch.cuda.max_memory_allocated() - before) / 1e6
