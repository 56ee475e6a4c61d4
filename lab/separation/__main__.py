"""Do the runs of the study that are to be done, then write its documents.

python -m lab.separation --jobs 2        (or: make study; it resumes where it was stopped)
"""

from __future__ import annotations

import sys

from lab.documents import OUTPUTS
from lab.grid.command import Command
from lab.separation.report import write_committed_report
from lab.separation.runs import FILE, STUDY

COMMAND = Command(
    STUDY,
    FILE,
    write_committed_report,
    OUTPUTS / "separation",
    "python -m lab.separation",
    __doc__ or "",
)

if __name__ == "__main__":
    sys.exit(COMMAND.main())
