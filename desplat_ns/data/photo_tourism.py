"""Photo Tourism scenes: COLMAP's undistorted photos and NeRF-W's split."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.core.console import announce_once, list_names
from desplat_ns.data.colmap import DeSplatColmapDataParser, OwnSplitConfig
from desplat_ns.data.colmap_model import find_models
from desplat_ns.data.split_file import draw_split, find_split_file, read_split_file
from desplat_ns.data.splits import Lists

DENSE = Path("dense")
"""Folder of undistorted photos and their reconstruction, side by side, in the data."""


@dataclass
class PhotoTourismDataParserConfig(OwnSplitConfig):
    """Photo Tourism scene: dense/images, dense/sparse and NeRF-W's split file."""

    _target: type = field(default_factory=lambda: PhotoTourismDataParser)
    images_path: Path = DENSE / "images"
    """Photos, relative to the data; without this option dense/images or, where there is no
    dense/sparse, images."""
    colmap_path: Path = DENSE / "sparse"
    """Reconstruction, relative to the data; without this option dense/sparse or sparse, or the
    largest model in there (sparse/0, sparse/1, ...)."""
    split_file: Path | None = None
    """NeRF-W's split file, relative to the data: filename, id, split, with tabs between. Without
    this option the .tsv file in the data or in dense/ that has these columns."""


class PhotoTourismDataParser(DeSplatColmapDataParser):
    """See `PhotoTourismDataParserConfig`."""

    config: PhotoTourismDataParserConfig
    split_by = "the split file; without one a tenth is drawn for testing"

    def __init__(self, config: PhotoTourismDataParserConfig):
        super().__init__(with_paths(config))

    def lists(self, names: Sequence[str]) -> Lists:
        """By the split file, or drawn; says once how. Raises CaptureError as `find_split_file` and
        `read_split_file`."""
        data, named = self.config.data, self.config.split_file
        path = data / named if named else find_split_file(split_folders(data))
        lists = read_split_file(path) if path is not None else draw_split(names)
        how = f"by {path}" if path is not None else "drawn, as there is no split file"
        train, test = lists["train"], lists["test"]
        announce_once(
            f"Split, {how}: of {len(names)} photos {len(train)} train, and {len(test)} are for "
            f"testing: {list_names(sorted(test))}."
        )
        return lists


def split_folders(data: Path) -> list[Path]:
    """Where a scene's split file may be. Whoever names dense/ itself as the data has it one folder
    up."""
    above = [data / ".."] if data.resolve().name == DENSE.name else []
    return [data, data / DENSE, *above]


def with_paths(config: PhotoTourismDataParserConfig) -> PhotoTourismDataParserConfig:
    """The same with photos and reconstruction side by side in the data itself where there is a
    reconstruction, and none in dense/; options come before that.

    Photos of one place never go with the reconstruction of the other: in dense/ they are
    undistorted, outside perhaps not.
    """
    default, data, outside = PhotoTourismDataParserConfig(), config.data, Path("sparse")
    if config.colmap_path != default.colmap_path or find_models(data, config.colmap_path):
        return config
    if not find_models(data, outside):
        return config
    is_named = config.images_path != default.images_path
    images = config.images_path if is_named else Path("images")
    return replace(config, images_path=images, colmap_path=outside)


photo_tourism_dataparser = DataParserSpecification(
    config=PhotoTourismDataParserConfig(),
    description="Photo Tourism scene: dense/images, dense/sparse, NeRF-W's split file.",
)
