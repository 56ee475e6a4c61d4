"""Run the parts of a plan one after the other, the kernels beside the first of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from desplat_ns.cores import cores
from lab.gpu.plan import KERNELS, LEAST, PARTS, Job, Part, kernel_jobs
from lab.gpu.processes import PartProcess
from lab.gpu.records import LEFT_OUT, NO_TIME, Record, Run

Written = Callable[[Run], object]
"""Called with all records whenever there is one more."""


class Runner:
    """A run of all parts; each of them may fail by itself."""

    def __init__(
        self,
        job: Job,
        seconds: float,
        written: Written,
        say: Callable[[str], object] = print,
        parts: Sequence[Part] = PARTS,
        run: Run | None = None,
    ) -> None:
        """Args:
        seconds: left for everything.
        written: is given the records after each part.
        run: its parts that are not run here keep their records.
        """
        self.job, self.parts, self._written, self._say = job, parts, written, say
        self._began = time.monotonic()
        self._ends = self._began + seconds
        self.run = run or Run(job.device, job.quick)
        self.run.parts |= {part.name: Record() for part in parts}
        named = (part for part in parts if part.name == KERNELS.name)
        self._kernels_part = next(named, None)
        self._kernels: PartProcess | None = None

    def __call__(self) -> Run:
        """Run everything that there is time for."""
        job = self.job
        job.folder.mkdir(parents=True, exist_ok=True)
        running: PartProcess | None = None
        try:
            if self._kernels_part is not None:
                self._kernels = self._start(self._kernels_part)
            for part in self.parts:
                unavailable_reason = self._unavailable_reason(part)
                if unavailable_reason is not None:
                    self._keep(part, unavailable_reason)
                    continue
                running = self._kernels if part is self._kernels_part else self._start(part)
                assert running is not None
                self._keep(part, running.wait())
        finally:
            for process in (running, self._kernels):
                if process is not None:
                    process.end()
        return self.run

    def _start(self, part: Part) -> PartProcess:
        self._say(f"[{self._seconds():4.0f} s] {part.title}, {part.deadline:.0f} s at most")
        return PartProcess(part, self.job, self._ends, environment_of(part))

    def _unavailable_reason(self, part: Part) -> Record | None:
        """Why a part is not begun."""
        left = self._ends - time.monotonic()
        if part is not self._kernels_part and left < LEAST:
            return Record(NO_TIME, deadline=part.deadline, why=f"{max(left, 0):.0f} s were left")
        kernels = self.run.parts.get(KERNELS.name)
        if part.needs_kernels and kernels is not None and not kernels.is_measured:
            why = f"gsplat's kernels are not there ({kernels.state}: {kernels.why})"
            return Record(LEFT_OUT, deadline=part.deadline, why=why)
        return None

    def _keep(self, part: Part, record: Record) -> None:
        self.run.parts[part.name] = record
        why = f": {record.why}" if record.why else ""
        done = f"{part.title}: {record.state} in {record.seconds:.0f} s{why}"
        self._say(f"[{self._seconds():4.0f} s] {done}")
        for line in record.log:
            self._say(f"         {line}")
        self._written(self.run)

    def _seconds(self) -> float:
        return time.monotonic() - self._began


def environment_of(part: Part) -> dict[str, str]:
    """Variables of one part: the compiler has most of the cores, for all else waits for it, and the
    training beside it the rest."""
    few = max(1, cores() // 8)
    common = {"OMP_WAIT_POLICY": "passive"}
    if part.name == KERNELS.name:
        return common | {"MAX_JOBS": str(kernel_jobs())}
    if part.name == "training.cpu":
        return common | {"OMP_NUM_THREADS": str(few), "NUMBA_NUM_THREADS": str(few)}
    return common
