"""A training step's stages against the roofline of the cores: `python -m lab.bench.stages`.

The limit of a stage is the larger of its bytes over the memory's bandwidth and its operations over
the cores' rate, both measured here. What a stage must read and write and compute is counted simply:
each array once, and operations of what is looked at, where `PER_PAIR` and its like say how many.
"""

import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import numba
import numpy as np
import torch

from desplat_ns.backend import numba_tiles
from desplat_ns.backend.numba_kernels import binning, projection, runtime, sh, ssim
from desplat_ns.core.effects import Effects
from lab import markdown_table
from lab.bench.model_step import ModelStep
from lab.bench.scenes import make_scene
from lab.bench.timing import threads

CASES = ((50_000, 960, 540), (300_000, 960, 540), (50_000, 1920, 1080), (300_000, 1920, 1080))
"""Gaussians, width and height."""
REPETITIONS = 10

DRAW, PULL = 42, 84
"""Operations of a (pixel, Gaussian) pair in each pass, a product and a sum each one; exp is 15."""
PROJECT, BIN, ENTRY = 400, 60, 40
"""Of a Gaussian, forward and backward; of a Gaussian and of an entry of the lists."""
HARMONICS = 2 * 16 * 3 * 3
"""Of a Gaussian: 16 coefficients of three colours, forward and twice backward."""
SSIM = 3 * (5 * 2 * 11 * 2 + 3 * 2 * 11 * 2 + 40)
"""Of a pixel: five blurred planes forward, three backward, 11 taps each way, three colours."""
ADAM = 14
"""Of a number."""

STAGES = {
    "_project": "project", "_backward": "project", "_evaluate": "harmonics",
    "_count": "tile lists", "_fill": "tile lists", "_write_spans": "tile lists",
    "draw_frame": "blend", "backward_frame": "blend, backward", "sum_rows": "sum rows",
    "score_image": "SSIM and L1",
}  # fmt: skip
"""By kernel; `_backward` of harmonics is told from that of the projection by its module."""


def bandwidth() -> float:
    """Bytes a CPU second of a copy of 512 MB, read and written, by all of numba's threads."""
    source, target = np.ones((2, 1 << 26))
    parts = numba.get_num_threads()

    @numba.njit(parallel=True)
    def copy(a: Any, b: Any) -> None:
        for i in numba.prange(parts):
            size = a.size // parts
            b[i * size : (i + 1) * size] = a[i * size : (i + 1) * size]

    return 2 * target.nbytes / median_of(lambda: copy(source, target), 7)


def rate() -> float:
    """Operations a CPU second of a product of float32 matrices by all of torch's threads."""
    a = torch.rand(1024, 1024)
    return 2 * 1024**3 / median_of(lambda: a @ a, 15)


def median_of(call: Callable[[], object], repetitions: int) -> float:
    """CPU seconds of a call, after a first one."""
    call()
    taken = []
    for _ in range(repetitions):
        began = time.process_time()
        call()
        taken.append(time.process_time() - began)
    return statistics.median(taken)


@contextmanager
def watched(seconds: dict[str, float], seen: dict[str, Any]) -> Iterator[None]:
    """Within, launches add their time to their stage's, and the tile lists are kept in `seen`."""

    def launch(kernel: Any, *arguments: Any) -> None:
        name, module = kernel.py_func.__name__, kernel.py_func.__module__
        began = time.process_time()
        runtime.launch(kernel, *arguments)
        stage = "harmonics" if module == sh.__name__ else STAGES[name]
        seconds[stage] += time.process_time() - began
        if name == "draw_frame":
            seen["lists"] = arguments[0]

    lists = binning.tile_lists

    def tile_lists(*arguments: Any) -> Any:
        began, before = time.process_time(), seconds["tile lists"]
        found = lists(*arguments)
        seconds["tile lists"] = before + time.process_time() - began
        return found

    patches: list[Any] = [
        mock.patch.object(module, "launch", launch)
        for module in (numba_tiles, binning, projection, sh, ssim)
    ]
    patches.append(mock.patch.object(numba_tiles, "tile_lists", tile_lists))
    for patch in patches:
        patch.start()
    try:
        yield
    finally:
        for patch in patches:
            patch.stop()


def timed_stages(step: ModelStep) -> tuple[dict[str, float], Any]:
    """Median CPU seconds of each stage of a step, and its tile lists."""
    step()
    taken, seen = defaultdict[str, list[float]](list), dict[str, Any]()
    for _ in range(REPETITIONS):
        seconds = defaultdict[str, float](float)
        with watched(seconds, seen):
            began = time.process_time()
            step.optimizers.zero_grad_all()
            losses = step.model.get_loss_dict(step.model(step.camera), {"image": step.photo})
            torch.stack(list(losses.values())).sum().backward()
            updated = time.process_time()
            step.optimizers.optimizer_step_all()
            end = time.process_time()
        seconds["Adam"] = end - updated
        seconds["all else"] = end - began - sum(seconds.values())
        seconds["step"] = end - began
        for stage, value in seconds.items():
            taken[stage].append(value)
    return {stage: statistics.median(values) for stage, values in taken.items()}, seen["lists"]


def needed(gaussians: int, pixels: int, lists: Any) -> dict[str, tuple[float, float]]:
    """Bytes and operations of each stage."""
    seen, entries, ranges = lists.ids.size, lists.ranks.size, lists.row_ranges
    rows = np.int64(0)
    for block in range(binning.BLOCKS):
        first, end = ranges[2 * block * entries :][:entries], ranges[(2 * block + 1) * entries :]
        rows += np.maximum(end[:entries].astype(np.int64) - first, 0).sum()
    pairs, record = float(rows * binning.BLOCK), 4 * binning.RECORD
    return {
        "project": (gaussians * 4 * (11 + 11 + 11 + 10 + 11), gaussians * PROJECT),
        "harmonics": (gaussians * 4 * (48 + 3 + 48 + 48 + 6), seen * HARMONICS),
        "tile lists": (seen * 3 * record + entries * 22, seen * BIN + entries * ENTRY),
        "blend": (entries * (record + 8) + pixels * 28, pairs * DRAW),
        "blend, backward": (entries * (record + 8 + 48) + pixels * 28, pairs * PULL),
        "sum rows": (entries * 52 + seen * 48, entries * 12),
        "SSIM and L1": (pixels * 4 * 9, pixels * SSIM),
        "Adam": (gaussians * 59 * 28, gaussians * 59 * ADAM),
    }


def main() -> None:
    """Print a table for each number of threads."""
    for number in (1, 2):
        with threads(number):
            per_second, operations = bandwidth(), rate()
            print(f"{number} threads: {per_second / 1e9:.1f} GB/s, {operations / 1e9:.0f} GFLOP/s")
            rows: dict[str, list[str]] = defaultdict(list)
            for count, width, height in CASES:
                step = ModelStep(make_scene(count, width, height), Effects(distractors=False))
                seconds, lists = timed_stages(step)
                limits = needed(count, width * height, lists)
                for stage in [*limits, "all else", "step"]:
                    cells = [f"{1e3 * seconds[stage]:.1f}"]
                    if stage in limits:
                        memory, compute = (
                            limits[stage][0] / per_second,
                            limits[stage][1] / operations,
                        )
                        cells += [f"{limits[stage][0] / 1e6:.0f}", f"{limits[stage][1] / 1e6:.0f}"]
                        cells += [f"{seconds[stage] / max(memory, compute):.1f}"]
                        cells[-1] += " m" if memory > compute else " c"
                    rows[stage].append(" / ".join(cells))
            head = ["stage", *(f"{n // 1000}k @ {w} x {h}" for n, w, h in CASES)]
            print(markdown_table(head, [[stage, *cells] for stage, cells in rows.items()]))


if __name__ == "__main__":
    main()
