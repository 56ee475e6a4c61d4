"""One part in a process of its own: a crash, or a deadline, ends no more than this.

    python -m lab.gpu.part NAME TARGET.json JOB      (JOB: JSON of a `plan.Job`)

A part's `measure(job)` yields its figures as often as it has more of them; each time they are
written, so that what is ended early leaves what it had.
"""

from __future__ import annotations

import importlib
import json
import sys
import traceback
from pathlib import Path

from lab.gpu.plan import Job
from lab.gpu.records import write_json


def main(arguments: list[str]) -> int:
    """Entry point; 0 where everything was measured."""
    name, target, job_text = arguments
    path, job = Path(target), Job(**json.loads(job_text))
    try:
        module = importlib.import_module(f"{job.package}.{name.partition('.')[0]}")
        for figures in module.measure(job):
            write_json(path, figures)
    except Exception as error:
        traceback.print_exc()
        write_json(path.with_suffix(".error"), f"{type(error).__name__}: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
