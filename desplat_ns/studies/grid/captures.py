"""Where a study's photos come from: a real capture, a generated one, or an altered one."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import RLock
from typing import Protocol, runtime_checkable

from desplat_ns.errors import DeSplatError
from desplat_ns.synthetic import SceneSpec, write_scene

DATA_VARIABLE = "DESPLAT_NS_DATA"
"""Environment variable with the folder that holds real captures."""

_writing = RLock()  # runs beside each other share what is generated


@runtime_checkable
class Capture(Protocol):
    """A folder of photos that a dataparser reads."""

    def locate(self, folder: Path) -> Path:
        """The capture's folder; what has to be written is written below `folder`, once.

        Raises:
            DeSplatError: it is not there and cannot be made.
        """
        ...


@dataclass(frozen=True)
class RealCapture:
    """A folder in DESPLAT_NS_DATA."""

    name: str

    def locate(self, folder: Path) -> Path:
        """See `Capture`; nothing is written."""
        found = Path(os.environ.get(DATA_VARIABLE, "")) / self.name
        if not found.is_dir():
            raise DeSplatError(
                f"The capture '{self.name}' is not at '{found}'. Set {DATA_VARIABLE} to the folder "
                "that holds it, or choose runs on generated captures: --only '*-yard*'."
            )
        return found


@dataclass(frozen=True)
class GeneratedCapture:
    """A synthetic scene, whose truth is known."""

    name: str
    spec: SceneSpec

    def locate(self, folder: Path) -> Path:
        """See `Capture`."""
        return made(folder / self.name, lambda path: write_scene(self.spec, path))


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
        return made(folder / self.name, lambda path: self.alter(original, path))


def made(path: Path, make: Callable[[Path], object]) -> Path:
    """What `make` writes; beside its place first, so that a stopped study leaves nothing half."""
    with _writing:
        if not path.exists():
            draft = path.with_name(f"{path.name}.draft")
            shutil.rmtree(draft, ignore_errors=True)
            make(draft)
            draft.rename(path)
    return path
