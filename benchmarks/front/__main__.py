"""Do the runs that are to be done, then write docs/accuracy-and-time.md.

python -m benchmarks.front --jobs 2        (it resumes where it was stopped)

DESPLAT_NS_DATA names the folder with the real scenes.
"""

from __future__ import annotations

import sys

from benchmarks.documents import OUTPUTS
from benchmarks.front.report import write_report
from benchmarks.front.runs import FILE, STUDY
from desplat_ns.studies.grid.command import Command

COMMAND = Command(
    STUDY, FILE, write_report, OUTPUTS / "front", "python -m benchmarks.front", __doc__ or ""
)

if __name__ == "__main__":
    sys.exit(COMMAND.main())
