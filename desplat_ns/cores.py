"""How many of the machine's cores this process may use."""

from __future__ import annotations

import os


def cores() -> int:
    """As the process's affinity says (`taskset`, a cluster's scheduler), where the system has one;
    else all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
