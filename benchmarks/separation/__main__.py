"""Do the runs of the study that are to be done, then write its documents.

python -m benchmarks.separation --jobs 2        (or: make study; it resumes where it was stopped)
"""

from __future__ import annotations

import sys

from benchmarks.documents import OUTPUTS
from benchmarks.separation.records import FILE
from benchmarks.separation.report import write_committed_report
from benchmarks.separation.runs import STUDY
from desplat_ns.studies.grid.command import Command

COMMAND = Command(
    STUDY,
    FILE,
    write_committed_report,
    OUTPUTS / "separation",
    "python -m benchmarks.separation",
    __doc__ or "",
)

if __name__ == "__main__":
    sys.exit(COMMAND.main())
