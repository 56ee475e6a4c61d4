"""Each effect on and off, on photos of changing light; writes docs/photo_tourism.md.

    python -m benchmarks.photo_tourism --jobs 2        (it resumes where it was stopped)

Trained and evaluated in one process and with one thread each. DESPLAT_NS_DATA names the folder
that holds the real scene; without it, its runs fail, and say so.
"""

from __future__ import annotations

import sys

from benchmarks.documents import OUTPUTS
from benchmarks.photo_tourism.report import write_report
from benchmarks.photo_tourism.runs import FILE, STUDY
from desplat_ns.studies.grid.command import Command

COMMAND = Command(
    STUDY,
    FILE,
    write_report,
    OUTPUTS / "photo_tourism",
    "python -m benchmarks.photo_tourism",
    __doc__ or "",
)

if __name__ == "__main__":
    sys.exit(COMMAND.main())
