"""What a run has measured: one record for each part, in one JSON file."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from desplat_ns.files.whole import write_whole

FILE = "gpu.json"

MEASURED, FAILED, LATE = "measured", "failed", "beyond its deadline"
NO_TIME, LEFT_OUT, WAITING = "no time left", "left out", "not begun"

Figures = dict[str, Any]
"""JSON values; each part has its own."""

_PLACE = re.compile(r"(?<![\w.:/])~?/(?:[\w.+@=-]+/)+([\w.+@=-]*)")


def without_places(text: str) -> str:
    """A text with paths cut down to their last names: records name no machine's folders."""
    return _PLACE.sub(lambda match: match[1] or "a folder", text)


@dataclass
class Record:
    """How a part went."""

    state: str = WAITING
    seconds: float = 0.0
    """Wall time, start of its process included."""
    deadline: float = 0.0
    """Seconds that it could have taken."""
    why: str = ""
    """Where it was not measured: the reason."""
    figures: Figures = field(default_factory=dict)
    """What it has measured; of a part beyond its deadline, what it had by then."""
    log: list[str] = field(default_factory=list)
    """Of a part that was not measured, the last lines that it printed."""

    @property
    def is_measured(self) -> bool:
        return self.state == MEASURED


@dataclass
class Run:
    """All of it."""

    device: str
    quick: bool
    parts: dict[str, Record] = field(default_factory=dict)
    """By name, in the order of the plan."""
    made_by: str = ""
    """Commit and GPU: figures of another are not gone on with."""

    def goes_on(self, earlier: Run) -> dict[str, Record]:
        """What `earlier` measured of the same parts, by the same code on the same GPU."""
        key = (self.device, self.quick, self.made_by)
        if (earlier.device, earlier.quick, earlier.made_by) != key:
            return {}
        return {name: record for name, record in earlier.parts.items() if record.is_measured}

    @property
    def is_stand_in(self) -> bool:
        """Whether its figures mean nothing."""
        return self.quick or self.device == "cpu"

    def save(self, folder: Path) -> Path:
        """Write `gpu.json`; whoever kills the run finds the last whole one."""
        path = folder / FILE
        write_json(path, asdict(self))
        return path

    @classmethod
    def load(cls, path: Path) -> Run:
        """What `save` wrote."""
        content = json.loads(path.read_text("utf8"))
        parts = {name: Record(**record) for name, record in content.pop("parts").items()}
        return cls(**content, parts=parts)


def write_json(path: Path, value: Any) -> None:
    """Atomically."""
    write_whole(path, (json.dumps(value, indent=1) + "\n").encode())
