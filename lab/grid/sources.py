"""Tables that say of which code their records are, and mark the cells that are of other code.

Two records belong together if the settings of both are those of the reference: today's, or in a
table of older figures those of the same commit. What does not belong to the most of a table's
records bears a mark, and the line below the table says what the mark means.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from desplat_ns.console import list_names
from desplat_ns.studies.machine import short
from lab.grid.records import Record
from lab.grid.runs import Run
from lab.grid.settings import Settings, changes
from lab.grid.tables import table

MARKS = ("†", "‡", "§", "¶", "‖")
MOST_NAMED = 3
"""Settings that a line names before it only counts."""
ABSENT = "absent"
"""Instead of the value of a setting that code did not have yet, or has no more."""

Measured = tuple[Run, Record]

Reference = Callable[[Run], Settings]
"""What today's code resolves for a run: `Study.settings_of`."""


@dataclass(frozen=True)
class Cell:
    """A table's cell, and the records that it was worked out from."""

    text: str
    records: tuple[Measured, ...] = ()


@dataclass(frozen=True)
class Source:
    """What a record is of, as far as two records may differ in it."""

    commit: str | None
    differs: tuple[str, ...] | None = ()
    """Settings that are not the reference's, in words; None if they were not recorded."""

    where: str = ""
    """Device and backend, where the table has records of several."""

    @property
    def is_current(self) -> bool:
        return self.differs == ()

    def describe(self) -> str:
        """Its code, its settings and what it was measured on, as far as they are to be told."""
        return self._of_what() + (f", on {self.where}" if self.where else "")

    def _of_what(self) -> str:
        """For instance `of e944f25, with model.refinements 12 (today 15)`."""
        if self.commit is None and self.differs is None:
            return "whose commit and settings were not recorded"
        commit = f"of {short(self.commit)}" if self.commit else "whose commit was not recorded"
        if self.differs is None:
            return f"{commit}, settings not recorded"
        if not self.differs:
            return commit
        return f"{commit}, with {list_names(self.differs, MOST_NAMED)}"


def sourced_table(
    head: Sequence[str], rows: Sequence[Sequence[str | Cell]], today: Reference | None
) -> str:
    """A Markdown table with the line that names its sources below it.

    Args:
        rows: of texts, and of cells with their records.
        today: None for a table of older figures, which are compared with each other.
    """
    measured = {
        _key(run, record): (run, record)
        for row in rows
        for cell in row
        if isinstance(cell, Cell)
        for run, record in cell.records
    }
    reference = today or _first_of_each_cell(list(measured.values()))
    whose = "today" if today else "others"
    places = {place_of(record) for _, record in measured.values()} - {""}
    sources = {
        key: source_of(run, record, reference, whose, tell_where=len(places) > 1)
        for key, (run, record) in measured.items()
    }
    marks = _marks(list(sources.values()), by_commit=today is None)

    def text(cell: str | Cell) -> str:
        if isinstance(cell, str):
            return cell
        found = dict.fromkeys(marks[sources[_key(*one)]] for one in cell.records)
        return cell.text + "".join(found) if cell.text else ""

    lines = table(head, [[text(cell) for cell in row] for row in rows])
    return f"{lines}\n\n{_line(list(sources.values()), marks)}"


def _key(run: Run, record: Record) -> tuple[Run, int]:
    """A table may hold two records of a run: of older code, and of today's."""
    return run, id(record)


def place_of(record: Record) -> str:
    """For instance `cuda (gsplat)`; empty where it is not known."""
    return f"{record.device} ({record.backend})" if record.device and record.backend else ""


def source_of(
    run: Run, record: Record, reference: Reference, whose: str, tell_where: bool = False
) -> Source:
    """What a record is of, its settings compared with those of a reference.

    Args:
        whose: the reference's settings are called in a table.
        tell_where: its device and backend, too.
    """
    where = (place_of(record) or "an unknown device") if tell_where else ""
    if record.settings is None:
        return Source(record.commit, None, where)
    found, wanted = record.settings, reference(run)
    differs = (
        f"{name.removeprefix('pipeline.')} {found.get(name, ABSENT)} "
        f"({whose} {wanted.get(name, ABSENT)})"
        for name in changes(found, wanted)
    )
    return Source(record.commit, tuple(differs), where)


def _first_of_each_cell(measured: list[Measured]) -> Reference:
    """The settings of the first seed, with which the others of a cell are compared."""
    first: dict[str, Settings] = {}
    for run, record in measured:
        if record.settings is not None:
            first.setdefault(run.cell, record.settings)
    return lambda run: first[run.cell]


def _marks(sources: list[Source], by_commit: bool) -> dict[Source, str]:
    """A mark for each source, none for the first kind: today's settings, or what most are of.

    Today's settings on one device are of one kind whatever commit they are of; in older figures
    (`by_commit`) each commit is a kind.
    """
    kinds = {
        s: s if by_commit or not s.is_current else Source(None, where=s.where) for s in sources
    }
    counts = Counter(kinds[s] for s in sources)

    def rank(kind: Source) -> tuple[bool, int]:
        return by_commit or not kind.is_current, -counts[kind]

    ordered = sorted(counts, key=rank)
    marks = dict(zip(ordered, _endless_marks(), strict=False))
    return {source: marks[kind] for source, kind in kinds.items()}


def _endless_marks() -> Iterator[str]:
    yield ""
    times = 1
    while True:
        yield from (mark * times for mark in MARKS)
        times += 1


def _line(sources: list[Source], marks: dict[Source, str]) -> str:
    """How many records are of what."""
    counts = Counter(sources)
    parts = [
        f"{marks[source]} {count} {source.describe()}".strip()
        for source, count in sorted(counts.items(), key=lambda one: (marks[one[0]], -one[1]))
    ]
    return f"Records: {'; '.join(parts)}."
