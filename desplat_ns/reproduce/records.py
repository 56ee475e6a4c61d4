"""The runs that are done, in a file: a table can be ended at any time and goes on from it.

records.json    the record of every run, and what it was of
runs/           what is trained, without checkpoints
TABLE/          table.md, table.html, table.csv, table.tex, table.json
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from desplat_ns.errors import ConfigError
from desplat_ns.files.lock import IN_USE
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.studies.machine import code_version, short
from desplat_ns.studies.runs import RESULTS, Record, Run

FILE, RUNS = "records.json", "runs"
FORMAT = 1

TEXTS = ("lpips_net", "lpips_reason", "protocol", "versions")
"""What an evaluation says beside figures."""


@dataclass(frozen=True)
class Done:
    """A run that was measured."""

    record: Record
    asked: tuple[str, ...]
    """Method, capture and options."""
    texts: dict[str, Any]
    """What was said of the evaluation, see `TEXTS`."""


def asked_of(run: Run) -> tuple[str, ...]:
    """What a run is, beside its name."""
    return (run.variant.method, str(run.data), *run.options)


def texts_of(run: Run, folder: Path) -> dict[str, Any]:
    """What a run's evaluation said beside figures; empty where it left no file."""
    path = folder / run.name / RESULTS
    if not path.is_file():
        return {}
    results = json.loads(path.read_text())
    said = {name: results["figures"][name] for name in TEXTS if name in results["figures"]}
    return said | {"device": results.get("device_name", "unknown")}


@dataclass
class Records:
    """All runs of an output folder, whatever their table."""

    done: dict[str, Done] = field(default_factory=dict)
    """By the names of the runs."""
    code: str = field(default_factory=code_version)

    def of(self, run: Run) -> Done | None:
        """What is known of a run.

        Raises:
            ConfigError: one of its name was of another folder, or had other options.
        """
        done = self.done.get(run.name)
        if done is not None and done.asked != asked_of(run):
            raise ConfigError(
                f"The output folder has a run {run.name} that was another: "
                f"`{' '.join(done.asked)}`. Name another --output."
            )
        return done

    def save(self, folder: Path) -> None:
        """Write records.json, whole or not at all. Raises ConfigError where that cannot be done."""
        rows = {name: asdict(done) for name, done in self.done.items()}
        content = {"format": FORMAT, "code": self.code, "done": rows}
        with plain_errors(folder / FILE, "--output"):
            write_whole(folder / FILE, (json.dumps(content, indent=1) + "\n").encode())

    @classmethod
    def load(cls, folder: Path) -> Records:
        """What `save` wrote; none where nothing is.

        Raises:
            ConfigError: the folder holds something else, or the runs of other code.
        """
        path = folder / FILE
        if not path.exists():
            there = folder.iterdir() if folder.is_dir() else ()
            if folder.is_file() or any(path.name not in (IN_USE, RUNS) for path in there):
                raise ConfigError(
                    f"--output is '{folder}', which holds something that is no table's. Name a new "
                    "or empty folder."
                )
            return cls()
        try:
            content = json.loads(path.read_text("utf8"))
            if content["format"] != FORMAT:
                raise ValueError("it is of another version")
            done = {name: _done(row) for name, row in content["done"].items()}
            records = cls(done, content["code"])
        except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
            raise ConfigError(f"{path} is damaged ({error}). Name another --output.") from error
        if records.code != code_version():
            raise ConfigError(
                f"{folder} holds runs by {short(records.code)}, and this is "
                f"{short(code_version())}: one table is not made of both. Name another --output."
            )
        return records


def _done(row: dict[str, Any]) -> Done:
    return Done(Record.from_json(row["record"]), tuple(row["asked"]), row["texts"])
