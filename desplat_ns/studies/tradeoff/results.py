"""What a study has found so far, in files: it can be ended at any time and goes on from them.

results.json     the capture, the plan, the time spent, all figures
training.json    the records of the trainings, as every study keeps them
runs/            what is trained
report.html, *.svg, *.png
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from desplat_ns.errors import ConfigError
from desplat_ns.files.lock import IN_USE
from desplat_ns.files.whole import write_whole
from desplat_ns.studies.grid.machine import describe_machine
from desplat_ns.studies.grid.records import Records
from desplat_ns.studies.tradeoff.plan import TrainingPlan
from desplat_ns.studies.tradeoff.subject import Subject

FILE, RECORDS, RUNS = "results.json", "training.json", "runs"
FORMAT = 2


@dataclass
class Results:
    """All but the trainings, which the grid's records hold."""

    subject: Subject
    spent: float = 0.0
    """Seconds of wall time, of all sittings."""
    jobs: int = 1
    """Runs beside each other."""
    plan: TrainingPlan | None = None
    """Settled before the first training."""
    failed: dict[str, str] = field(default_factory=dict)
    """Why a cell gave no figure, by its name."""
    left_out: list[str] = field(default_factory=list)
    """Runs for which no time was left."""
    machine: dict[str, str] = field(default_factory=describe_machine)

    def save(self, folder: Path, records: Records) -> None:
        """Write results.json; whole or not at all.

        Raises:
            ConfigError: nothing can be written there, for instance because the disk is full.
        """
        content = {"format": FORMAT, **asdict(self), "training": training_rows(records)}
        target = folder / FILE
        try:
            write_whole(target, (json.dumps(content, indent=1) + "\n").encode())
        except OSError as error:
            raise ConfigError(
                f"{target} cannot be written ({error}). Make room or name another --output; the "
                "same command then goes on with what is there."
            ) from error

    @classmethod
    def load(cls, folder: Path) -> Results | None:
        """What `save` wrote; None where nothing is.

        Raises:
            ConfigError: the folder holds something else, or a file that cannot be read.
        """
        path = folder / FILE
        if not path.exists():
            _check_free(folder)
            return None
        try:
            content = json.loads(path.read_text("utf8"))
            if content.pop("format") != FORMAT:
                raise ValueError("it is of another version")
            del content["training"]
            subject = Subject.from_json(content.pop("subject"))
            plan = content.pop("plan")
            settled = plan and TrainingPlan(plan["steps"], tuple(plan["settings"]), plan["most"])
            return cls(subject, plan=settled, **content)
        except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
            raise ConfigError(
                f"{path} is not a study's, or is damaged ({error}). Name another --output."
            ) from error


def _check_free(folder: Path) -> None:
    there = folder.iterdir() if folder.is_dir() else ()
    if folder.is_file() or any(path.name != IN_USE for path in there):
        raise ConfigError(
            f"--output is '{folder}', which holds something that is no study of this kind. Name a "
            "new or empty folder."
        )


def training_rows(records: Records) -> dict[str, Mapping[str, Any]]:
    """Figures of the trainings by the names of their runs."""
    return {
        name: {**record.figures, "curve": record.curve, "commit": record.commit}
        for name, record in sorted(records.items())
    }
