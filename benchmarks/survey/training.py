"""Train what the survey says, everything and nothing; docs/survey.md has the figures side by side.

    python -m benchmarks.survey.training --jobs 2        (it resumes where it was stopped)

DESPLAT_NS_DATA names the folder with the scenes.
"""

from __future__ import annotations

import sys

from benchmarks.documents import OUTPUTS
from benchmarks.survey.report import write_report
from benchmarks.survey.runs import STUDY, TRAINING
from desplat_ns.studies.grid.command import Command

COMMAND = Command(
    STUDY,
    TRAINING,
    write_report,
    OUTPUTS / "survey_training",
    "python -m benchmarks.survey.training",
    __doc__ or "",
)

if __name__ == "__main__":
    sys.exit(COMMAND.main())
