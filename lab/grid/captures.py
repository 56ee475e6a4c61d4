"""Where a study's photos come from: a real capture, a generated one, or an altered one."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import RLock

from desplat_ns.errors import DeSplatError
from lab.grid.runs import DATA_VARIABLE, Capture
from lab.synthetic import SceneSpec, write_scene

DIGITS = 6
"""Of its description's digest, at the end of the name of what is written."""

_writing = RLock()  # runs beside each other share what is generated


@dataclass(frozen=True)
class RealCapture:
    """A folder in DESPLAT_NS_DATA."""

    name: str

    def locate(self, folder: Path) -> Path:
        """See `Capture`; nothing is written."""
        data = Path(os.environ.get(DATA_VARIABLE, "")) / self.name
        if not data.is_dir():
            raise DeSplatError(
                f"The capture '{self.name}' is not at '{data}'. Set {DATA_VARIABLE} to the folder "
                "that holds it, or choose runs on generated captures: --only '*-yard*'."
            )
        return data

    def describe(self) -> str:
        """See `Capture`: the folder's name; what lies in it is not read."""
        return self.name


@dataclass(frozen=True)
class GeneratedCapture:
    """A synthetic scene, whose truth is known."""

    name: str
    spec: SceneSpec

    def locate(self, folder: Path) -> Path:
        """See `Capture`."""
        return made(place_of(self, folder), lambda path: write_scene(self.spec, path))

    def describe(self) -> str:
        """See `Capture`: every field of the spec."""
        return repr(self.spec)


@dataclass(frozen=True)
class AlteredCapture:
    """Another capture with something added or taken away."""

    name: str
    original: Capture
    alter: Callable[[Path, Path], object]
    """Given the original's folder, writes the altered capture into a new one."""

    def locate(self, folder: Path) -> Path:
        """See `Capture`."""
        original = self.original.locate(folder).resolve()
        return made(place_of(self, folder), lambda path: self.alter(original, path))

    def describe(self) -> str:
        """See `Capture`: the case's name, and the original's description; what `alter` does is
        not read."""
        return f"{self.name} of {self.original.describe()}"


def place_of(capture: GeneratedCapture | AlteredCapture, folder: Path) -> Path:
    """Where a capture is written: another place once its description is another."""
    digest = hashlib.sha256(capture.describe().encode()).hexdigest()
    return folder / f"{capture.name}-{digest[:DIGITS]}"


def made(path: Path, make: Callable[[Path], object]) -> Path:
    """What `make` writes; beside its place first, so that a stopped study leaves nothing half."""
    with _writing:
        if not path.exists():
            draft = path.with_name(f"{path.name}.draft")
            shutil.rmtree(draft, ignore_errors=True)
            make(draft)
            draft.rename(path)
    return path
