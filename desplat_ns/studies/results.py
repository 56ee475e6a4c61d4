"""What a study has found so far, in files: it can be ended at any time and goes on from them.

results.json     the capture, the plan, the time spent, the record of every training
runs/            what is trained
report.html, *.svg, *.png
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from desplat_ns.errors import ConfigError
from desplat_ns.files.lock import IN_USE
from desplat_ns.files.whole import write_whole
from desplat_ns.studies.capture_info import CaptureInfo
from desplat_ns.studies.machine import code_version, describe_machine, short
from desplat_ns.studies.plan import TrainingPlan
from desplat_ns.studies.runs import Record

FILE, RUNS = "results.json", "runs"
FORMAT = 3


@dataclass
class Results:
    """All of it."""

    capture: CaptureInfo
    spent: float = 0.0
    """Seconds of wall time, of all sessions."""
    jobs: int = 1
    """Runs beside each other."""
    plan: TrainingPlan | None = None
    """Settled before the first training."""
    training: dict[str, Record] = field(default_factory=dict)
    """By the names of the runs."""
    code: str = field(default_factory=code_version)
    """That trains; other code makes another study."""
    failed: dict[str, str] = field(default_factory=dict)
    """Why a run gave no figure, by its name."""
    left_out: list[str] = field(default_factory=list)
    """Runs for which no time was left."""
    machine: dict[str, str] = field(default_factory=describe_machine)

    def save(self, folder: Path) -> None:
        """Write results.json; whole or not at all.

        Raises:
            ConfigError: nothing can be written there, for instance because the disk is full.
        """
        content = {"format": FORMAT, **asdict(self)}
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
            results = cls.from_json(content)
        except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
            raise ConfigError(
                f"{path} is not a study's, or is damaged ({error}). Name another --output."
            ) from error
        if results.code != code_version():
            raise ConfigError(
                f"{folder} holds a study by {short(results.code)}, and this is "
                f"{short(code_version())}: their trainings are not compared. Name another --output."
            )
        return results

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> Results:
        """What `save` wrote, without its format. Raises KeyError, TypeError where it did not."""
        capture, plan = CaptureInfo.from_json(content.pop("capture")), content.pop("plan")
        settled = plan and TrainingPlan(plan["steps"], tuple(plan["variants"]), plan["most"])
        rows = content.pop("training").items()
        training = {name: Record.from_json(row) for name, row in rows}
        return cls(capture, plan=settled, training=training, **content)


def _check_free(folder: Path) -> None:
    there = folder.iterdir() if folder.is_dir() else ()
    if folder.is_file() or any(path.name != IN_USE for path in there):
        raise ConfigError(
            f"--output is '{folder}', which holds something that is no study of this kind. Name a "
            "new or empty folder."
        )
