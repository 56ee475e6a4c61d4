"""How many of the machine's cores this process may use."""

from __future__ import annotations

import os
from functools import cache


def cores() -> int:
    """As the process's affinity says (`taskset`, a cluster's scheduler), where the system has one;
    else all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@cache
def leave_cores_to_others() -> None:
    """Give torch half of its threads, once in a process, unless OMP_NUM_THREADS says how many.

    They wait for each other by spinning, which takes the time of a step several times over where
    another program has one of the cores; numba's do most of the work (docs/results/speed.md).
    """
    import torch  # here, as it takes long, and other commands count cores

    if "OMP_NUM_THREADS" not in os.environ:
        torch.set_num_threads(max(1, torch.get_num_threads() // 2))
