"""Where the scenes of a table lie, and what is in them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from desplat_ns.console import list_names
from desplat_ns.errors import CaptureError
from desplat_ns.reproduce.protocols import Protocol, Scene, Smoke
from desplat_ns.reproduce.tables import Table
from desplat_ns.studies.methods import Content, content_of, split_of


@dataclass(frozen=True)
class FoundScene:
    """A scene whose folder is there."""

    protocol: Protocol
    scene: Scene
    folder: Path

    @property
    def parser(self) -> tuple[str, ...]:
        """Name and options of the data parser, as `ns-train` takes them."""
        size = self.scene.downscale
        smaller = () if size is None else ("--downscale-factor", str(size))
        return (*self.protocol.parser, *smaller, *self.scene.options)


def find_scenes(table: Table, data: Path) -> tuple[list[FoundScene], list[Scene]]:
    """Scenes of a table whose folders are there, and those that are missing.

    They are looked for in the folder that `desplat-fetch-data` makes for their data set, in `data`
    or being `data`.

    Raises:
        CaptureError: there is no such folder.
    """
    if not data.is_dir():
        raise CaptureError(f"There is no folder '{data}'. Name that with the data sets by --data.")
    found, missing = [], []
    for protocol in table.protocols:
        for scene in protocol.scenes:
            names = (scene.folder, scene.folder.replace("_", "-"))
            places = (home / name for home in _homes(protocol, data) for name in names)
            folder = next((place for place in places if place.is_dir()), None)
            if folder is None:
                missing.append(scene)
            else:
                found.append(FoundScene(protocol, scene, folder.resolve()))
    return found, missing


def any_scenes(table: Table, data: Path) -> Iterator[FoundScene]:
    """Captures of other names in the same places, for a smoke run."""
    for protocol in table.protocols:
        homes = (home for home in _homes(protocol, data) if home.is_dir())
        places = [data, *(place for home in homes for place in sorted(home.iterdir()))]
        for place in dict.fromkeys(place.resolve() for place in places):
            if any((place / name).is_dir() for name in ("images", "dense", "sparse")):
                name = f"{protocol.folder}/{place.name}" if len(table.protocols) > 1 else place.name
                yield FoundScene(protocol, Scene(name, place.name, None, ""), place)


def what_is_missing(missing: list[Scene], data: Path) -> str:
    """Which scenes, where they were looked for, and what to type."""
    fetches = dict.fromkeys(scene.fetch for scene in missing)
    typed = ", ".join(f"`desplat-fetch-data {name} --folder {data}`" for name in fetches)
    folders = list_names(dict.fromkeys(scene.folder for scene in missing), 12)
    return f"Not in '{data}': {folders}. Fetch what is missing: {typed}."


def _homes(protocol: Protocol, data: Path) -> tuple[Path, ...]:
    """Folders in which a data set's scenes may be; some archives have one of their own name."""
    return data / protocol.folder, data / protocol.folder / protocol.folder, data


def read_scene(found: FoundScene) -> Content:
    """What a scene's data parser finds, which makes sure that all photos are there. Raises
    CaptureError as `outputs_of`."""
    return content_of(outputs_of(found, "train"), outputs_of(found, "test"))


def outputs_of(found: FoundScene, split: str) -> Any:
    """nerfstudio's DataparserOutputs of a split.

    Raises:
        CaptureError: it cannot be read, or no photo is in it; the message names the scene.
    """
    try:
        return split_of("desplat-paper", found.folder, found.parser, split)
    except CaptureError as error:
        raise CaptureError(
            f"{found.protocol.title}, {found.scene.name}: {error} Where the data set is not whole, "
            f"move '{found.folder.parent}' away and fetch the data set again."
        ) from error


def smaller(found: FoundScene, side: int) -> FoundScene:
    """The same with photos of at most `side` pixels a side. Raises CaptureError as `outputs_of`."""
    cameras = outputs_of(replace(found, scene=replace(found.scene, downscale=1)), "train").cameras
    longest = int(max(cameras.width.max(), cameras.height.max()))
    factor = 2 ** max(0, math.ceil(math.log2(longest / side)))
    return replace(found, scene=replace(found.scene, downscale=factor))


def checked(scenes: list[FoundScene], smoke: Smoke | None = None) -> dict[FoundScene, Content]:
    """Scenes with their content; of a smoke run those that can be read.

    Raises:
        CaptureError: a scene cannot be read; of a smoke run none can.
    """
    contents: dict[FoundScene, Content] = {}
    wrong: list[str] = []
    for scene in scenes:
        if any(f.folder == scene.folder and f.protocol != scene.protocol for f in contents):
            continue  # of a smoke run: another data set's way of reading it came first
        try:
            scene = scene if smoke is None else smaller(scene, smoke.side)
            contents[scene] = read_scene(scene)
        except CaptureError as error:
            wrong.append(str(error))
    if wrong and not (smoke is not None and contents):
        raise CaptureError("\n".join(wrong))
    return contents
