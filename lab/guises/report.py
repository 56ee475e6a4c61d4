"""docs/dev/machines.md: on which machines the suite passed, from the records in
docs/records/machines.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from string import Template
from typing import Any

from lab.documents import DEV, RECORDS
from lab.gpu.records import write_json
from lab.grid.tables import text_table
from lab.guises.guises import GUISES, Guise

TEMPLATE = Path(__file__).with_name("machines.md.template")
KEPT = ("passed", "failed", "error", "skipped", "seconds", "part", "bad")
OF_THE_MACHINE = ("Processor", "Python", "torch", "Commit", "Date")

Record = dict[str, Any]


def enter(guise: Guise, results: Mapping[str, Any], machine: Mapping[str, str]) -> None:
    """Keep a run, in place of an earlier one of that guise and minor version of Python."""
    path = RECORDS / "machines.json"
    records = json.loads(path.read_text("utf8")) if path.exists() else {}
    minor = machine["Python"].rpartition(".")[0]
    records[f"{guise.name} {minor}"] = {
        **{name: results[name] for name in KEPT},
        **{name: machine[name] for name in OF_THE_MACHINE},
    }
    write_json(path, records)
    (DEV / "machines.md").write_text(page(records), "utf8")


def page(records: Mapping[str, Record]) -> str:
    """The document's text."""
    rows = []
    for guise in GUISES:
        own = sorted(key for key in records if key.split()[0] == guise.name)
        rows += [_row(guise, records[key]) for key in own]
    head = ["machine", "Python", "tests", "passed", "failed", "skipped", "minutes"]
    results = text_table([*head, "processor", "commit, date"], rows)
    return Template(TEMPLATE.read_text("utf8")).substitute(results=results)


def _row(guise: Guise, record: Record) -> list[str]:
    bad = record["failed"] + record["error"]
    counts = [str(n) for n in (record["passed"], bad, record["skipped"])]
    minutes = f"{record['seconds'] / 60:.0f}"
    where = [record["Processor"], f"{record['Commit']}, {record['Date']}"]
    return [guise.title, record["Python"], record["part"], *counts, minutes, *where]
