"""What was measured: a file of JSON lines, one for each run, and tables of them in Markdown.

A record is history: it names its commit and the options given. Later code or defaults do not touch
it. To measure a run anew, delete its line.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from desplat_ns.errors import ConfigError
from desplat_ns.files.whole import IN_USE, plain_errors, write_whole
from desplat_ns.studies.machine import code_version, short

FILE = "records.jsonl"
"""Name of the file in a command's output folder."""

RUNS = "runs"
"""What is trained, beside it."""

Key = tuple[str, str, str, int]
"""Method, options, capture and seed: what tells a run from all others."""


@dataclass(frozen=True)
class Record:
    """A run that was measured."""

    commit: str
    """Of the code, as `machine.code_version` gives it."""
    date: str
    """Day on which the run ended, ISO 8601, UTC."""
    method: str
    """A name that nerfstudio knows, or `module:attribute` of a MethodSpecification."""
    options: str
    """Of `ns-train`, the data parser's included; without the seed and the folders."""
    capture: str
    seed: int
    scores: Mapping[str, Any]
    """Numbers and texts of the evaluation, by its names."""
    seconds: float | int
    """Wall time of the process from its start to its end."""
    device: str
    """Name of the GPU, or of the processor."""

    @property
    def key(self) -> Key:
        """What tells its run from all others."""
        return self.method, self.options, self.capture, self.seed


def load(path: Path) -> dict[Key, Record]:
    """The records of a file, none if there is no file; the later one of two of a run counts. Raises
    ConfigError where the file holds something else, or cannot be read."""
    try:
        lines = path.read_text("utf8").splitlines() if path.exists() else []
        records = [Record(**json.loads(line)) for line in lines]
    except (ValueError, TypeError, OSError) as error:
        raise ConfigError(f"'{path}' is damaged ({error}). Name another --output.") from error
    return {record.key: record for record in records}


def save(path: Path, records: Iterable[Record]) -> None:
    """Write a file of records, whole or not at all. Raises ConfigError where it cannot."""
    text = "".join(f"{json.dumps(asdict(record))}\n" for record in records)
    with plain_errors(path):
        write_whole(path, text.encode())


def open_records(folder: Path) -> dict[Key, Record]:
    """The records in a command's output folder, which has a file of them from then on. Raises
    ConfigError where the folder holds something else, or runs by other code."""
    there = folder.iterdir() if folder.is_dir() and not (folder / FILE).exists() else ()
    if any(path.name not in (IN_USE, RUNS) for path in there):
        raise ConfigError(
            f"--output is '{folder}', which holds something else. Name a new or empty folder."
        )
    records, code = load(folder / FILE), code_version()
    for other in {record.commit for record in records.values()} - {code}:
        raise ConfigError(
            f"'{folder}' holds runs by {short(other)}, and this is {short(code)}: their figures "
            "are not put together. Name another --output."
        )
    save(folder / FILE, records.values())
    return records


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]], align: str = "") -> str:
    """A Markdown table with `l` or `r` for each column, by default `l` for the first, `r` for all
    others. Bars within cells are escaped."""
    align = align or "l" + "r" * (len(head) - 1)
    rule = ["---" if side == "l" else "---:" for side in align]
    cells = ([cell.replace("|", "\\|") for cell in row] for row in (head, *rows))
    first, *others = (f"| {' | '.join(row)} |" for row in cells)
    return "\n".join([first, f"| {' | '.join(rule)} |", *others])
