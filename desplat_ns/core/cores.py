"""What of the machine this process may use: cores and memory."""

import os
from contextlib import suppress
from functools import cache
from pathlib import Path

import psutil


def cores() -> int:
    """As the process's affinity says (`taskset`, a cluster's scheduler), where the system has one;
    else all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@cache
def leave_cores_to_others() -> None:
    """Give torch half of its threads, once in a process, unless OMP_NUM_THREADS says how many: they
    wait by spinning, and numba's do most of the work (docs/results/speed.md)."""
    import torch  # here, as it takes long, and other commands count cores

    if "OMP_NUM_THREADS" not in os.environ:
        torch.set_num_threads(max(1, torch.get_num_threads() // 2))


def memory() -> tuple[int, int]:
    """Bytes of memory that there are, and those of them that nobody uses: of the machine, or of the
    container or job that the process runs in, where it may have less."""
    machine = psutil.virtual_memory()
    total, free = machine.total, machine.available
    for limit, used in _limits(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")):
        total, free = min(total, limit), min(free, max(0, limit - used))
    return total, free


def _limits(groups: Path, root: Path) -> list[tuple[int, int]]:
    """Limits of memory of the control groups of a process on Linux (both versions, by their own
    paths and, in a container, at the root), and what is used of each beside cached files; bytes."""
    found = []
    with suppress(OSError):
        for line in groups.read_text().splitlines():
            _, kinds, path = line.split(":", 2)
            if kinds and "memory" not in kinds.split(","):
                continue
            top, limit, used = root, "memory.max", "memory.current"
            if kinds:
                top, limit, used = root / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes"
            for folder in {top, top / path.lstrip("/")}:
                with suppress(OSError, ValueError):  # "max" says that there is none
                    most, now = int((folder / limit).read_text()), int((folder / used).read_text())
                    stat = dict(map(str.split, (folder / "memory.stat").read_text().splitlines()))
                    cached = stat.get("total_inactive_file", stat.get("inactive_file", 0))
                    found.append((most, now - int(cached)))
    return found
