"""Each effect on and off, on photos of changing light; writes docs/results/photo_tourism.md.

    python -m lab.photo_tourism --jobs 2        (it resumes where it was stopped)

Trained and evaluated in one process and with one thread each. DESPLAT_NS_DATA names the folder
that holds the real scene; without it, its runs fail, and say so.
"""

from __future__ import annotations

import sys

from lab.documents import OUTPUTS
from lab.grid.command import Command
from lab.photo_tourism.report import write_report
from lab.photo_tourism.runs import FILE, STUDY

COMMAND = Command(
    STUDY,
    FILE,
    write_report,
    OUTPUTS / "photo_tourism",
    "python -m lab.photo_tourism",
    __doc__ or "",
)

if __name__ == "__main__":
    sys.exit(COMMAND.main())
