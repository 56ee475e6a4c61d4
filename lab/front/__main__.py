"""Do the runs that are to be done, then write docs/results/accuracy-and-time.md.

python -m lab.front --jobs 2        (it resumes where it was stopped)

DESPLAT_NS_DATA names the folder with the real scenes.
"""

from __future__ import annotations

import sys

from lab.documents import OUTPUTS
from lab.front.report import write_report
from lab.front.runs import FILE, STUDY
from lab.grid.command import Command

COMMAND = Command(
    STUDY, FILE, write_report, OUTPUTS / "front", "python -m lab.front", __doc__ or ""
)

if __name__ == "__main__":
    sys.exit(COMMAND.main())
