"""Train what the survey says, everything and nothing, and write a table of their scores.

    python -m lab.survey.training --jobs 2        (it resumes where it was stopped)

DESPLAT_NS_DATA names the folder with the scenes.
"""

from __future__ import annotations

import sys

from lab.documents import OUTPUTS
from lab.grid.command import Command
from lab.survey.report import write_trained
from lab.survey.runs import STUDY, TRAINING

COMMAND = Command(
    STUDY,
    TRAINING,
    write_trained,
    OUTPUTS / "survey_training",
    "python -m lab.survey.training",
    __doc__ or "",
)

if __name__ == "__main__":
    sys.exit(COMMAND.main())
