"""Tables that say of which commits, and of which devices, their records are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from desplat_ns.studies.machine import short
from lab.grid.records import Record
from lab.grid.runs import Run
from lab.grid.tables import table

Measured = tuple[Run, Record]


@dataclass(frozen=True)
class Cell:
    """A table's cell, and the records that it was worked out from."""

    text: str
    records: tuple[Measured, ...] = ()


def sourced_table(head: Sequence[str], rows: Sequence[Sequence[str | Cell]]) -> str:
    """A Markdown table with the line that names its sources below it; rows are of texts, and of
    cells with their records."""
    records = {
        run: record
        for row in rows
        for cell in row
        if isinstance(cell, Cell)
        for run, record in cell.records
    }
    texts = [[cell if isinstance(cell, str) else cell.text for cell in row] for row in rows]
    return f"{table(head, texts)}\n\n{_sources(list(records.values()))}"


def _sources(records: list[Record]) -> str:
    """For instance `Records: 26 of 9f40bd7; 8 of cd12124.`; devices where there are several."""
    several = len({place_of(record) for record in records} - {""}) > 1
    counts = Counter(_source(record, several) for record in records)
    return f"Records: {'; '.join(f'{count} {name}' for name, count in counts.most_common())}."


def _source(record: Record, name_place: bool) -> str:
    commit = f"of {short(record.commit)}"
    return f"{commit}, on {place_of(record) or 'an unknown device'}" if name_place else commit


def place_of(record: Record) -> str:
    """For instance `cuda (gsplat)`; empty where it is not known."""
    return f"{record.device} ({record.backend})" if record.device and record.backend else ""
