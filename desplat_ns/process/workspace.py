"""The folder that becomes a capture: where things lie in it, and the record of what is done.

    OUTPUT/images         the undistorted photos                 } the capture
    OUTPUT/sparse/0       cameras, poses and points              }
    OUTPUT/cameras.png    cameras and points from above
    OUTPUT/process.json   what was asked for, the stages done with their times, the findings
    OUTPUT/work           photos, features, matches, models; removed at the end

`process.json` is replaced as a whole, so a kill leaves the old or the new one.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

from desplat_ns.console import list_names
from desplat_ns.errors import ConfigError, DeSplatError
from desplat_ns.files.whole import IN_USE, disk_is_full, write_whole

RECORD = "process.json"


@dataclass
class Workspace:
    """A capture in the making."""

    output: Path
    asked: Mapping[str, str]
    """The options that decide what comes out."""
    files: Mapping[str, int]
    """The sources and their sizes in bytes."""
    stages: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Those that are done, in order: `seconds` and `result`."""

    @property
    def work(self) -> Path:
        """Where everything lies that only matters until the capture is made."""
        return self.output / "work"

    @property
    def picture(self) -> Path:
        """Cameras and points from above."""
        return self.output / "cameras.png"

    @property
    def log(self) -> Path:
        """What pycolmap said."""
        return self.work / "colmap.log"

    def stage(self, name: str, do: Callable[[], Any]) -> Any:
        """The result of a stage: what the record has, or what `do` gives, which is recorded."""
        if name not in self.stages:
            begin = monotonic()
            result = do()
            self.stages[name] = {"seconds": round(monotonic() - begin, 1), "result": result}
            self.save()
        return self.stages[name]["result"]

    def forget(self, names: Iterable[str]) -> None:
        """Strike stages from the record, so that they are done again. Raises as `save`."""
        for name in list(names):
            self.stages.pop(name, None)
        self.save()

    def save(self) -> None:
        """Write the record.

        Raises:
            DeSplatError: it cannot be written.
        """
        record = {"asked": self.asked, "files": self.files, "stages": self.stages}
        try:
            self.work.mkdir(parents=True, exist_ok=True)
            text = json.dumps(record, indent=1, ensure_ascii=False)
            write_whole(self.output / RECORD, text.encode())
        except OSError as error:
            raise unwritable(self.output, error) from error

    def discard(self) -> None:
        """Remove the record as well: nothing came out that a second call could use."""
        self.remove_work()
        (self.output / RECORD).unlink(missing_ok=True)

    def remove_work(self) -> None:
        """Remove what only mattered on the way."""
        shutil.rmtree(self.work, ignore_errors=True)


def open_workspace(output: Path, asked: Mapping[str, str], files: Mapping[str, int]) -> Workspace:
    """A new folder, or the one in which a call with the same photos and options was at work.

    Raises:
        ConfigError: something else lies there, or other photos or options were processed there.
    """
    record = output / RECORD
    if not record.is_file():
        _check_nothing_there(output)
        folder = Workspace(output, asked, files)
        folder.save()
        return folder
    try:
        content = json.loads(record.read_text("utf8"))
        earlier = Workspace(output, content["asked"], content["files"], content["stages"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f"{record} cannot be read ({error}). Remove {output} to begin anew, or name another "
            "folder."
        ) from error
    changes = _changes(earlier, asked, files)
    if changes:
        raise ConfigError(
            f"{output} was begun with other photos or options: {'; '.join(changes)}. Give the same "
            f"to go on with it, name another folder, or remove {output} to begin anew."
        )
    return earlier


def _check_nothing_there(output: Path) -> None:
    if output.is_file():
        raise ConfigError(f"{output} is a file. Name a folder for the capture.")
    there = output.iterdir() if output.is_dir() else ()
    entries = sorted(path.name for path in there if path.name != IN_USE)
    if entries:
        raise ConfigError(
            f"{output} holds something else: {list_names(entries, 5)}. Nothing is written over: "
            "name a new or an empty folder."
        )


def _changes(earlier: Workspace, asked: Mapping[str, str], files: Mapping[str, int]) -> list[str]:
    changes = [
        f"--{name.replace('_', '-')} was {earlier.asked.get(name)} and is {value}"
        if name != "photos"
        else f"the photos were those of {earlier.asked.get(name)} and are those of {value}"
        for name, value in asked.items()
        if earlier.asked.get(name) != value
    ]
    for what, names in (
        ("are new", files.keys() - earlier.files.keys()),
        ("are gone", earlier.files.keys() - files.keys()),
        ("have changed", {n for n in files.keys() & earlier.files if files[n] != earlier.files[n]}),
    ):
        if names:
            changes.append(f"{len(names)} files {what} ({list_names(sorted(names), 3)})")
    return changes


def unwritable(output: Path, error: Exception) -> DeSplatError:
    """What to say where writing failed."""
    if disk_is_full(output):
        return disk_full(output)
    return ConfigError(f"Nothing can be written to {output} ({error}). Name another folder.")


def disk_full(output: Path) -> DeSplatError:
    """What to say where the disk is full."""
    return DeSplatError(
        f"The disk of {output} is full. What is done is kept: make room, and the same command goes "
        "on where it stopped. A smaller --longest-side, in another folder, needs less."
    )
