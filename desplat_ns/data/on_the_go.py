"""NeRF On-the-go captures: split.json says which photos train and which are held out.

`split.json` has the lists `clutter` (photos with distractors, which train), `extra` (held out) and,
in some scenes, `clean` (not used). Their entries are positions, from 0, among the photos of
transforms.json in the order of their file names. Source: the published dataset of NeRF On-the-go,
Ren et al., CVPR 2024. Its undistorted copy by the authors of WildGaussians has train_list.txt and
test_list.txt instead, with file names.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import index
from pathlib import Path, PurePosixPath
from typing import Any

from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.colmap import DeSplatColmapDataParser, OwnSplitConfig
from desplat_ns.data.colmap_model import find_models
from desplat_ns.data.photo_files import photo_names
from desplat_ns.data.reconstruction import Reconstruction
from desplat_ns.data.splits import Lists
from desplat_ns.data.transforms_json import read_transforms

SPLIT_FILE = "split.json"
TRANSFORMS_FILE = "transforms.json"


@dataclass
class OnTheGoDataParserConfig(OwnSplitConfig):
    """NeRF On-the-go scene: split.json over a COLMAP model, or over transforms.json."""

    _target: type = field(default_factory=lambda: OnTheGoDataParser)


class OnTheGoDataParser(DeSplatColmapDataParser):
    """See `OnTheGoDataParserConfig`. Of a COLMAP model and transforms.json it takes the model,
    which has points to start from."""

    split_by = f"{SPLIT_FILE}: `clutter` trains, `extra` is held out"

    def lists(self, names: Sequence[str]) -> Lists:
        """Raises CaptureError: a split.json that does not fit."""
        data, path = self.config.data, self.config.data / SPLIT_FILE
        if not path.exists() and (lists := super().lists(names)):
            return lists
        ordered, positions = ordered_names(data, self.config.images_path), read_split(path)
        if not all(0 <= i < len(ordered) for listed in positions.values() for i in listed):
            raise CaptureError(
                f"{path} lists photos that are not there: {len(ordered)} are, counted from 0. Take "
                "the split.json that belongs to this scene."
            )
        train, held_out = ([ordered[i] for i in positions[kind]] for kind in ("clutter", "extra"))
        return {"train": train, "test": held_out}

    def read(self) -> Reconstruction:
        """The COLMAP model, else transforms.json. Raises as their readers."""
        config = self.config
        if find_models(config.data, config.colmap_path):
            return super().read()
        return read_transforms(config.data / TRANSFORMS_FILE, config.load_3D_points)


def read_split(path: Path) -> dict[str, list[int]]:
    """The lists of a split file, by their names. Raises CaptureError where there is no such file,
    or it has no lists of positions under `clutter` and `extra`."""
    try:
        content: Any = json.loads(path.read_text("utf8"))
        return {name: list(map(index, content[name])) for name in ("clutter", "extra")}
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise CaptureError(
            f"{path} is no split file of NeRF On-the-go: it needs the lists `clutter` and `extra` "
            "of photos' positions (0, 1, ...) in the order of their file names."
        ) from error


def ordered_names(data: Path, images: Path) -> list[str]:
    """File names that positions in split.json count: those of transforms.json, else the photos."""
    path = data / TRANSFORMS_FILE
    if not path.is_file():
        return sorted(PurePosixPath(name).name for name in photo_names(data / images))
    return sorted(PurePosixPath(f.name).name for f in read_transforms(path, False).frames)


on_the_go_dataparser = DataParserSpecification(OnTheGoDataParserConfig())
