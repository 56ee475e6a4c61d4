"""What was measured, of which code and with which options: one JSON file for a study, a line each.

    {"off-clutter-2-1000-42": {"commit": "e944...", "given": "desplat --full-rate-visits 0",
                               "device": "cpu", "backend": "numba", "psnr": 25.4}}

A record is history: what code or defaults became since then does not touch it. To measure a run
anew, delete its line.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from desplat_ns.files.whole import write_whole
from desplat_ns.studies.machine import DIRTY
from desplat_ns.studies.runs import Figures
from lab.grid.runs import Run

_writing = Lock()


@dataclass(frozen=True)
class Record:
    """One run that was measured."""

    figures: Figures
    commit: str
    """Of the code, as `code_version` gives it."""
    given: str = ""
    """The method, its options and the data parser's, as `ns-train` was given them."""
    device: str | None = None
    """Its type, `cpu` or `cuda`; None if it is not known."""
    backend: str | None = None
    """The rasterizer that was used, whatever chose it; None as above."""
    curve: tuple[Figures, ...] = ()
    """The figures on the way and in the end, each with its `step`; empty if it was scored once."""


Records = dict[str, Record]
"""By the names of the runs."""


def load(path: Path) -> Records:
    """The records in a file, none if there is no file."""
    content = json.loads(path.read_text("utf8")) if path.exists() else {}
    return {name: _record(dict(fields)) for name, fields in content.items()}


def _record(fields: dict[str, Any]) -> Record:
    where = {name: fields.pop(name, None) for name in ("device", "backend")}
    commit, given, curve = fields.pop("commit"), fields.pop("given"), fields.pop("curve", ())
    return Record(fields, commit, given, **where, curve=tuple(curve))


def save(path: Path, records: Records) -> None:
    """Write a file of records, a line for each; whole or not at all."""
    lines = (f"{json.dumps(name)}: {json.dumps(_fields(r))}" for name, r in sorted(records.items()))
    write_whole(path, ("{\n" + ",\n".join(lines) + "\n}\n").encode())


def _fields(record: Record) -> dict[str, Any]:
    where = {"device": record.device, "backend": record.backend}
    known = {name: value for name, value in where.items() if value is not None}
    curve = {"curve": record.curve} if record.curve else {}
    return {"commit": record.commit, "given": record.given, **known, **record.figures, **curve}


def enter(path: Path, run: Run, record: Record) -> None:
    """Enter what was measured of a run; an older record of it is replaced."""
    with _writing:
        save(path, load(path) | {run.name: record})


def is_done(run: Run, records: Records) -> bool:
    """Whether there is a record of a run, of committed code."""
    record = records.get(run.name)
    return record is not None and not record.commit.endswith(DIRTY)
