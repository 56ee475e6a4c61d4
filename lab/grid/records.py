"""What was measured, of which code and with which settings: one JSON file for a study.

    {"records": {"off-clutter-2-1000-42": {"commit": "e944...", "settings": "5f...",
                                           "device": "cpu", "backend": "numba", "psnr": 25.4}},
     "settings": {"common": {"max_skipped_steps": 10}, "5f...": {"method_name": "desplat"}}}

A record names its settings by their digest; the names and values under that digest, and the common
ones, are the settings. What is not known is null: such a record is reported as what it is.

Code that changed while the settings stayed does not make a record stale: which change matters is
for people to judge, and the line below each table says of which commits its records are.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from threading import Lock
from typing import Any

from desplat_ns.files.whole import write_whole
from desplat_ns.studies.machine import DIRTY
from desplat_ns.studies.runs import Figures
from lab.grid.runs import Run, Study
from lab.grid.settings import Settings, changes, digest

COMMON = "common"
"""Instead of a digest: what all settings of a file share."""

_writing = Lock()


@dataclass(frozen=True)
class Record:
    """One run that was measured."""

    figures: Figures
    commit: str | None
    """Of the code, as `code_version` gives it; None if it is not known."""
    settings: Settings | None
    """As `settings_of` gives them; None if they are not known."""
    device: str | None = None
    """Its type, `cpu` or `cuda`; None if it is not known, as of older records."""
    backend: str | None = None
    """The rasterizer that was used, whatever chose it; None as above."""
    curve: tuple[Figures, ...] = ()
    """The figures on the way and in the end, each with its `step`; empty if it was scored once."""


Records = dict[str, Record]
"""By the names of the runs."""


class State(Enum):
    """Whether a run has to be done."""

    DONE = "done"
    MISSING = "never run"
    UNKNOWN = "its settings were not recorded"
    STALE = "its settings are not today's"
    ELSEWHERE = "it was not measured on what the study names"
    DIRTY = "its code was not committed"


def load(path: Path) -> Records:
    """The records in a file, none if there is no file."""
    if not path.exists():
        return {}
    content = json.loads(path.read_text())
    parts = content["settings"]
    settings = {key: parts[COMMON] | part for key, part in parts.items() if key != COMMON}
    return {name: _record(dict(fields), settings) for name, fields in content["records"].items()}


def _record(fields: dict[str, Any], settings: dict[str, Settings]) -> Record:
    commit, key = fields.pop("commit"), fields.pop("settings")
    device, backend = fields.pop("device", None), fields.pop("backend", None)
    curve = tuple(fields.pop("curve", ()))
    return Record(fields, commit, None if key is None else settings[key], device, backend, curve)


def save(path: Path, records: Records) -> None:
    """Write a file of records, a line for each; whole or not at all."""
    settings = {digest(r.settings): r.settings for r in records.values() if r.settings is not None}
    common = _common(list(settings.values()))
    parts = {
        key: {name: value for name, value in values.items() if name not in common}
        for key, values in sorted(settings.items())
    }
    entries = {
        name: {
            "commit": r.commit,
            "settings": None if r.settings is None else digest(r.settings),
            **{key: value for key, value in where(r).items() if value is not None},
            **r.figures,
            **({"curve": r.curve} if r.curve else {}),
        }
        for name, r in sorted(records.items())
    }
    content = {"records": _lines(entries), "settings": _lines({COMMON: common} | parts)}
    text = ",\n".join(f'"{key}": {lines}' for key, lines in content.items())
    write_whole(path, f"{{\n{text}\n}}\n".encode())


def where(record: Record) -> dict[str, str | None]:
    """What a record was measured on."""
    return {"device": record.device, "backend": record.backend}


def _common(settings: list[Settings]) -> Settings:
    """Names whose value is the same in all of several settings."""
    if not settings:
        return {}
    first, *others = settings
    return {
        name: value
        for name, value in first.items()
        if all(name in other and other[name] == value for other in others)
    }


def _lines(entries: Mapping[str, Any]) -> str:
    """A JSON object with one line for each entry."""
    lines = (f"{json.dumps(key)}: {json.dumps(entry)}" for key, entry in entries.items())
    return "{\n" + ",\n".join(lines) + "\n}"


def enter(path: Path, run: Run, record: Record) -> None:
    """Enter what was measured of a run, here or elsewhere; an older record of it is replaced."""
    with _writing:
        save(path, load(path) | {run.name: record})


def is_current(record: Record, wanted: Settings) -> bool:
    """Whether a record's settings are known, and those that are wanted."""
    return record.settings is not None and not changes(record.settings, wanted)


def state_of(study: Study, run: Run, records: Records) -> tuple[State, list[str]]:
    """Whether a run has to be done, and what differs: settings, or the device and the backend."""
    record = records.get(run.name)
    if record is None:
        return State.MISSING, []
    if record.settings is None:
        return State.UNKNOWN, []
    changed = changes(record.settings, study.settings_of(run))
    if changed:
        return State.STALE, changed
    wanted = {"device": study.device, "backend": study.backend}
    elsewhere = [name for name, value in where(record).items() if wanted[name] not in (None, value)]
    if elsewhere:
        return State.ELSEWHERE, elsewhere
    is_dirty = record.commit is not None and record.commit.endswith(DIRTY)
    return (State.DIRTY if is_dirty else State.DONE), []
