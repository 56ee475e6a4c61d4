"""Where the scenes of a table lie, and what is in them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

from desplat_ns.console import list_names
from desplat_ns.errors import CaptureError, ConfigError, DeSplatError
from desplat_ns.reproduce.protocols import Protocol, Scene, Smoke
from desplat_ns.reproduce.tables import Table


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


@dataclass(frozen=True)
class Content:
    """What the data parser finds in a scene."""

    photos: int
    """Of the training split."""
    held_out: int
    width: int
    height: int
    """Pixels of the median training photo."""
    points: int = 0
    """To start from; with none, training starts at random."""


def find_scenes(table: Table, data: Path) -> tuple[list[FoundScene], list[tuple[Protocol, Scene]]]:
    """Scenes of a table whose folders are there, and those that are missing.

    They are looked for in the folder that `desplat-fetch-data` makes for their data set, in `data`
    or being `data`.

    Raises:
        CaptureError: there is no such folder.
    """
    if not data.is_dir():
        raise CaptureError(f"There is no folder '{data}'. Name that with the data sets by --data.")
    found_scenes, missing = [], []
    for protocol in table.protocols:
        for scene in protocol.scenes:
            names = (scene.folder, scene.folder.replace("_", "-"))
            places = (home / name for home in _homes(protocol, data) for name in names)
            folder = next((place for place in places if place.is_dir()), None)
            if folder is None:
                missing.append((protocol, scene))
            else:
                found_scenes.append(FoundScene(protocol, scene, folder.resolve()))
    return found_scenes, missing


def any_scenes(table: Table, data: Path) -> list[FoundScene]:
    """Captures of other names in the same places, for a smoke run."""
    found_scenes = []
    for protocol in table.protocols:
        homes = (home for home in _homes(protocol, data) if home.is_dir())
        places = [data, *(place for home in homes for place in sorted(home.iterdir()))]
        for place in dict.fromkeys(place.resolve() for place in places):
            if _is_capture(place):
                name = f"{protocol.folder}/{place.name}" if len(table.protocols) > 1 else place.name
                scene = Scene(name, place.name, None, "")
                found_scenes.append(FoundScene(protocol, scene, place))
    return found_scenes


def what_is_missing(table: Table, missing: list[tuple[Protocol, Scene]], data: Path) -> str:
    """Which scenes, where they were looked for, and what to type."""
    folders = dict.fromkeys(f"{protocol.folder}/{scene.folder}" for protocol, scene in missing)
    fetches = dict.fromkeys(scene.fetch for _, scene in missing)
    typed = ", ".join(f"`desplat-fetch-data {name} --folder {data}`" for name in fetches)
    text = f"Not in '{data}': {list_names(folders, 12)}. Fetch what is missing: {typed}."
    return text + _hint(table, data)


def _hint(table: Table, data: Path) -> str:
    """Where the scenes lie instead, if the folder is of a wrong level."""
    if _is_capture(data):
        above = data.resolve().parent
        return f" '{data}' is a single capture: name the folder of all, --data {above}."
    for protocol in table.protocols:
        names = {scene.folder for scene in protocol.scenes}
        deeper = [path for path in sorted(data.glob("*/*/*/")) if path.name in names]
        if deeper:
            return f" There is a '{deeper[0]}': perhaps --data {deeper[0].parent} is meant."
    return ""


def _homes(protocol: Protocol, data: Path) -> tuple[Path, ...]:
    """Folders in which a data set's scenes may be; some archives have one of their own name."""
    return data / protocol.folder, data / protocol.folder / protocol.folder, data


def _is_capture(folder: Path) -> bool:
    return any((folder / name).is_dir() for name in ("images", "dense", "sparse"))


def read_scene(found_scene: FoundScene) -> Content:
    """What a scene's data parser finds, which makes sure that all photos are there.

    Raises:
        CaptureError: it cannot be read, or no photo is held out; the message names the scene.
    """
    outputs = outputs_of(found_scene, "train")
    tested = outputs_of(found_scene, "test")
    cameras = outputs.cameras
    return Content(
        len(cameras),
        len(tested.cameras),
        int(cameras.width.median()),
        int(cameras.height.median()),
        len(outputs.metadata.get("points3D_xyz", ())),
    )


def outputs_of(found_scene: FoundScene, split: str):
    """Cameras, photos and points of a split. Raises CaptureError as `read_scene`."""
    from desplat_ns.studies.methods import parse

    try:
        config = parse("desplat-paper", ["--data", str(found_scene.folder), *found_scene.parser])
        manager = config.pipeline.datamanager
        manager.data = found_scene.folder
        outputs = manager.settle_dataparser().setup().get_dataparser_outputs(split)
    except (DeSplatError, ValueError, IndexError, OSError) as error:
        raise CaptureError(
            f"{found_scene.protocol.title}, {found_scene.scene.name}: {error} Where the data "
            f"set is not whole, move '{found_scene.folder.parent}' away and fetch the data set "
            "again."
        ) from error
    if len(outputs.cameras) == 0:
        raise CaptureError(f"'{found_scene.folder}' has no photo of the {split} split.")
    return outputs


def smaller(found_scene: FoundScene, side: int) -> FoundScene:
    """The same with photos of at most so many pixels a side. Raises as `read_scene`."""
    whole = replace(found_scene, scene=replace(found_scene.scene, downscale=1))
    cameras = outputs_of(whole, "train").cameras
    longest = int(max(cameras.width.max(), cameras.height.max()))
    factor = 2 ** max(0, math.ceil(math.log2(longest / side)))
    return replace(found_scene, scene=replace(found_scene.scene, downscale=factor))


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
        except (CaptureError, ConfigError) as error:
            wrong.append(str(error))
    if wrong and not (smoke is not None and contents):
        raise CaptureError("\n".join(wrong))
    return contents
