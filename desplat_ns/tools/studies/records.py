"""What was measured: a file of JSON lines, one for each run, with its commit and the options given;
later code or defaults do not touch it. To measure a run anew, delete its line."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from desplat_ns.core.errors import ConfigError
from desplat_ns.core.whole import check_ours, write_output
from desplat_ns.tools.studies.machine import code_version, short

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
    """A name that nerfstudio knows."""
    options: str
    """Of `ns-train`, the data parser's included; without the seed and the folders."""
    capture: str
    seed: int
    scores: Mapping[str, Any]
    """Numbers and texts of the evaluation, by its names."""
    seconds: float | int
    """Wall time with set-up and evaluation."""
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
    write_output(path, text.encode())


def open_records(folder: Path) -> dict[Key, Record]:
    """The records in a command's output folder, which has a file of them from then on. Raises
    ConfigError where the folder holds something else, or runs by other code."""
    if not (folder / FILE).exists():
        check_ours(folder, RUNS)
    records, code = load(folder / FILE), code_version()
    for other in {record.commit for record in records.values()} - {code}:
        raise ConfigError(
            f"'{folder}' holds runs by {short(other)}, and this is {short(code)}: their figures "
            "are not put together. Name another --output."
        )
    save(folder / FILE, records.values())
    return records


def conditions_of(records: Iterable[Record]) -> dict[str, list[str]]:
    """How, on what and by which code runs were measured: each value once, by what it is."""
    known = list(records)

    def said(name: str) -> list[str]:
        return sorted({str(record.scores[name]) for record in known if name in record.scores})

    return {
        "LPIPS net": said("lpips_net"),
        "no LPIPS because": said("lpips_reason"),
        "scored": said("protocol"),
        "devices": sorted({record.device for record in known}),
        "backends": said("backend"),
        "versions": said("versions"),
        "commit": sorted({short(record.commit) for record in known}),
    }
