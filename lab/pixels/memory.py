"""Peak memory of one forward + backward, in a process of its own.

python -m lab.pixels.memory NAME COUNT WIDTH HEIGHT      prints MiB, or n/a

NAME is a backend's, or `module:ATTRIBUTE` of another contender.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from desplat_ns.studies.runs import surroundings

if TYPE_CHECKING:
    from lab.pixels.contenders import Contender

TINY = (200, 64, 48)
"""Count, width and height of the scene that pays for imports, compilation and thread pools."""


def measure_peak(contender: Contender, size: tuple[int, int, int]) -> float | None:
    """MiB above what the process held before, of a contender on the scene of `size`.

    In a subprocess with all cores. None where the system does not tell (no Linux /proc).
    """
    name = contender.address or contender.name
    return answer_of("lab.pixels.memory", name, *map(str, size))


def answer_of(module: str, *arguments: str, **variables: str) -> float | None:
    """MiB that a module's `answer` says in a process of its own; None for n/a."""
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        env=surroundings(**variables),
        check=True,
        capture_output=True,
        text=True,
    )
    said = done.stdout.split()[-1]
    return None if said == "n/a" else float(said)


def answer(measure: Callable[[], float]) -> None:
    """Print MiB, or n/a where the system does not tell them."""
    try:
        print(f"{measure():.1f}")
    except OSError:
        print("n/a")


def status_mib(key: str) -> float:
    """A size of this process, by its name in /proc/self/status. Raises OSError without one."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{key}:"):
            return int(line.split()[1]) / 1024
    raise OSError(f"/proc/self/status has no {key}")


def _return_free_memory() -> None:
    """Give back what the allocator keeps for later, which would hide as much of the peak."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def peak_in_this_process(name: str, size: tuple[int, int, int]) -> float:
    """As `measure_peak`, here and now. Raises OSError where the system does not tell.

    Args:
        name: see `contender_called`.
    """
    from desplat_ns.backend import Rendering
    from desplat_ns.calibration.scenes import Scene, make_scene, tensors_of
    from lab.pixels.contenders import contender_called
    from lab.pixels.rasterizing import SETTINGS, forward_and_both

    contender = contender_called(name)

    def run(scene: Scene) -> None:
        splats = scene.splats()

        def render() -> Rendering:
            return contender.rasterizer(splats, scene.view, SETTINGS)

        forward_and_both(render, tensors_of(splats))[1]()

    run(make_scene(*TINY))
    scene = make_scene(*size)
    return peak_mib(lambda: run(scene))


def peak_mib(call: Callable[[], object]) -> float:
    """MiB above what this process holds now, while `call` runs. Raises OSError as `status_mib`."""
    _return_free_memory()
    Path("/proc/self/clear_refs").write_text("5")  # VmHWM starts anew
    before = status_mib("VmRSS")
    call()
    return status_mib("VmHWM") - before


if __name__ == "__main__":
    count, width, height = map(int, sys.argv[2:5])
    answer(lambda: peak_in_this_process(sys.argv[1], (count, width, height)))
