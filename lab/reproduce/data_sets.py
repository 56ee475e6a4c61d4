"""Generated scenes, small ones, laid out as `desplat-fetch-data` leaves the published data sets."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

from desplat_ns.data.photo_files import photo_names
from lab.synthetic import SceneSpec, write_scene

TINY = SceneSpec.tiny()


def write_data_sets(folder: Path, spec: SceneSpec = TINY) -> None:
    """Crab (2), Yoda, Patio-High, Sacre Coeur and garden, each in its data set's folder.

    Args:
        spec: of the scenes; Sacre Coeur has changing light besides, the others are the same.
    """
    scene = folder / "robustnerf" / "crab2"
    write_scene(spec, scene)
    for copy in ("robustnerf/yoda", "mipnerf360/garden", "on-the-go/patio_high"):
        shutil.copytree(scene, folder / copy)
    write_split(folder / "on-the-go" / "patio_high")
    tourism = SceneSpec.tourism()
    light = replace(spec, daylight=tourism.daylight, wall_height=tourism.wall_height)
    light = replace(light, layout="phototourism")
    write_scene(light, folder / "phototourism" / "sacre_coeur")


def write_split(scene: Path) -> None:
    """On-the-go's split.json for a scene that `write_scene` made: positions among the sorted file
    names."""
    names = sorted(photo_names(scene / "images"))
    lists = {
        kind: [i for i, name in enumerate(names) if kind in name]
        for kind in ("clutter", "clean", "extra")
    }
    (scene / "split.json").write_text(json.dumps(lists))
