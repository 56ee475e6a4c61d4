"""Which parts a run has, in what order, and how long each may take."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from desplat_ns.cores import cores

TOTAL = 570.0
"""Seconds that everything may take, so that it ends within ten minutes: the rest is for writing.
Where the kernels need more than their deadline here, by so much more."""

LEAST = 5.0
"""Seconds. With less left a part is not begun."""

PATIENCE = 4.0
"""By how much a rehearsal on a busy processor may take longer, in all and in every part."""


@dataclass(frozen=True)
class Part:
    """One question, and what it takes to answer it."""

    name: str
    """Module of `lab.gpu.parts` and, behind a dot, one of its cases."""
    title: str
    deadline: float
    """Seconds after which it is ended; what it has by then is kept."""
    needs_kernels: bool = True
    """Whether it draws with gsplat: it then waits for the kernels, and is left out without them."""

    def patient(self) -> Part:
        """The same with a deadline for a rehearsal."""
        return replace(self, deadline=PATIENCE * self.deadline)


KERNELS = Part("kernels", "gsplat's kernels compiled", 360, needs_kernels=False)
"""Begun first, beside the parts that do without. Its deadline is for twelve cores and more."""


def kernel_jobs() -> int:
    """Files of gsplat's kernels that are compiled at once: memory decides, and the training beside
    them keeps an eighth of the cores."""
    from desplat_ns.backend.gsplat_kernels import build  # takes torch's seconds: not for `--help`

    return min(build.jobs(), max(1, cores() - max(1, cores() // 8)))


def with_time_to_compile(part: Part) -> Part:
    """The kernels' part with the deadline that this machine asks for: twice the expected time."""
    from desplat_ns.backend.gsplat_kernels import build

    expected = 60 * build.CPU_MINUTES / kernel_jobs()
    return replace(part, deadline=max(part.deadline, 2 * expected))


PARTS = (
    Part("machine", "The machine", 40, needs_kernels=False),
    Part("training.cpu", "Training on the CPU", 300, needs_kernels=False),
    KERNELS,
    Part("suite", "The tests that need a GPU", 120),
    Part("parity", "gsplat against the CPU's backends", 60),
    Part("steps", "Time of a training step", 100),
    Part("synchronisations", "Synchronisations of a step", 75),
    Part("rendering", "Frames per second", 80),
    Part("training.gpu", "Training on the GPU", 90),
    Part("training.real", "fox_cluttered trained on the GPU", 240),
)
"""In the order in which they are waited for."""


@dataclass(frozen=True)
class Job:
    """What a part is told."""

    device: str
    """"cuda"; or "cpu" for the stand-in, whose figures mean nothing."""
    quick: bool
    """Tiny sizes, to see whether everything runs."""
    work: str
    """Folder for what a part leaves for others, and for its own files."""
    case: str = ""
    """What stands behind the dot of the part's name."""
    package: str = "lab.gpu.parts"
    """Where the parts are."""

    @property
    def is_stand_in(self) -> bool:
        """Whether the CPU takes the GPU's place."""
        return self.device == "cpu"

    @property
    def backend(self) -> str:
        """The rasterizer that is looked at: gsplat, or numba in its place."""
        return "numba" if self.is_stand_in else "gsplat"

    @property
    def folder(self) -> Path:
        return Path(self.work)
