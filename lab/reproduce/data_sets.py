"""Generated scenes, small ones, laid out as `desplat-fetch-data` leaves the published data sets."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from desplat_ns.data.photo_files import photo_names
from lab.synthetic import SceneSpec, write_scene

TINY = SceneSpec.tiny()


def write_data_sets(folder: Path, spec: SceneSpec = TINY) -> None:
    """Crab (2), Yoda, Patio-High, Sacre Coeur and garden, each in its data set's folder.

    Args:
        spec: of the scenes; Sacre Coeur has changing light besides.
    """
    for seed, name in enumerate(("crab2", "yoda")):
        write_scene(replace(spec, seed=seed), folder / "robustnerf" / name)
    write_on_the_go(folder / "on-the-go" / "patio_high", spec)
    tourism = SceneSpec.tourism()
    light = replace(spec, daylight=tourism.daylight, wall_height=tourism.wall_height)
    light = replace(light, layout="phototourism")
    write_scene(light, folder / "phototourism" / "sacre_coeur")
    write_scene(spec, folder / "mipnerf360" / "garden")


def write_on_the_go(folder: Path, spec: SceneSpec = TINY) -> None:
    """A scene with split.json: positions among the sorted file names."""
    write_scene(spec, folder)
    names = sorted(photo_names(folder / "images"))
    lists = {
        kind: [i for i, name in enumerate(names) if kind in name]
        for kind in ("clutter", "clean", "extra")
    }
    (folder / "split.json").write_text(json.dumps(lists))
