"""NeRF On-the-go captures: split.json says which photos train and which are held out.

`split.json` has the lists `clutter` (photos with distractors, which train), `extra` (held out) and,
in some scenes, `clean` (not used). Their entries are positions, from 0, among the photos of
transforms.json in the order of their file names. Source: the published dataset of NeRF On-the-go,
Ren et al., CVPR 2024. Its undistorted copy by the authors of WildGaussians has train_list.txt and
test_list.txt instead, with file names.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.console import announce_once, list_names
from desplat_ns.data.colmap import DeSplatColmapDataParser, OwnSplitConfig
from desplat_ns.data.colmap_model import find_models
from desplat_ns.data.photo_files import photo_names
from desplat_ns.data.reconstruction import Reconstruction
from desplat_ns.data.transforms_json import read_transforms
from desplat_ns.errors import CaptureError

SPLIT_FILE = "split.json"
TRANSFORMS_FILE = "transforms.json"


@dataclass
class OnTheGoDataParserConfig(OwnSplitConfig):
    """NeRF On-the-go scene: split.json over a COLMAP model, or over transforms.json."""

    _target: type = field(default_factory=lambda: OnTheGoDataParser)


class OnTheGoDataParser(DeSplatColmapDataParser):
    """See `OnTheGoDataParserConfig`. Of a COLMAP model and transforms.json it takes the model,
    which has points to start from."""

    config: OnTheGoDataParserConfig

    def views(self, names: Sequence[str], split: str) -> list[int]:
        """Indices of a split's photos among `names`, paths inside the images folder.

        Raises:
            CaptureError: a split.json that does not fit, or no photo for this split.
        """
        data, kind = self.config.data, "clutter" if split == "train" else "extra"
        path = data / SPLIT_FILE
        if not path.exists() and (data / "test_list.txt").exists():
            return super().views(names, split)
        ordered, lists = ordered_names(data, self.config.images_path), read_split(path)
        positions = lists.get(kind, [])
        if not positions or not all(0 <= i < len(ordered) for i in positions):
            raise CaptureError(
                f"{path} lists as `{kind}` the photos {list_names(map(str, positions)) or 'none'}; "
                f"there are {len(ordered)}, counted from 0. It needs `clutter` photos to train on "
                "and `extra` photos to hold out: take the split.json that belongs to this scene."
            )
        if split == "train" and (both := {*positions} & {*lists["extra"]}):
            raise CaptureError(
                f"{path} lists {len(both)} photos to train on and to hold out, too: "
                f"{list_names(ordered[i] for i in sorted(both))}. Take each out of one list."
            )
        wanted = {ordered[i] for i in positions}
        picked = [i for i, name in enumerate(names) if PurePosixPath(name).name in wanted]
        missing = wanted - {PurePosixPath(names[i]).name for i in picked}
        if not picked:
            raise CaptureError(
                f"None of the {len(wanted)} {split} photos that {path} lists has a "
                f"pose: {list_names(sorted(wanted))}. The capture has {list_names(names)}."
            )
        if missing:
            announce_once(
                f"{len(missing)} of {len(wanted)} {split} photos in {path} have no "
                f"pose and are left out: {list_names(sorted(missing))}.",
                warning=True,
            )
        return picked

    def read(self) -> Reconstruction:
        """The COLMAP model, else transforms.json. Raises as their readers."""
        config = self.config
        if find_models(config.data, config.colmap_path):
            return super().read()
        return read_transforms(config.data / TRANSFORMS_FILE, config.load_3D_points)


def read_split(path: Path) -> dict[str, list[int]]:
    """The lists of a split file, by their names.

    Raises:
        CaptureError: no such file, or not lists of positions under `clutter` and `extra`.
    """
    try:
        content: Any = json.loads(path.read_text("utf8")) if path.is_file() else None
    except (OSError, ValueError) as error:
        raise CaptureError(f"The split file {path} cannot be read: {error}.") from error
    lists = content if isinstance(content, dict) else {}
    lists = {name: lists[name] for name in ("clutter", "extra") if name in lists}
    is_valid = all(
        isinstance(positions, list) and all(type(entry) is int for entry in positions)
        for positions in lists.values()
    )
    if not (is_valid and len(lists) == 2):
        raise CaptureError(
            f"{path} is no split file of NeRF On-the-go: it needs the lists `clutter` and `extra` "
            "of photos' positions (0, 1, ...) in the order of their file names."
        )
    return lists


def ordered_names(data: Path, images: Path) -> list[str]:
    """File names that positions in split.json count: those of transforms.json, else the photos."""
    path = data / TRANSFORMS_FILE
    if not path.is_file():
        return sorted(PurePosixPath(name).name for name in photo_names(data / images))
    return sorted(PurePosixPath(f.name).name for f in read_transforms(path, False).frames)


on_the_go_dataparser = DataParserSpecification(
    config=OnTheGoDataParserConfig(),
    description="NeRF On-the-go scene: split.json says which photos train and which are held out.",
)
