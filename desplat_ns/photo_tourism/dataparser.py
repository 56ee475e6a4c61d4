"""Photo Tourism scenes: COLMAP's undistorted photos and NeRF-W's split."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.console import announce_once, list_names
from desplat_ns.data.colmap import DeSplatColmapDataParser, OwnSplitConfig
from desplat_ns.data.colmap_model import find_models
from desplat_ns.data.splits import Lists
from desplat_ns.errors import CaptureError
from desplat_ns.photo_tourism.split_file import draw_split, find_split_file, read_split_file
from desplat_ns.settings.options import ranged

ROOTS = (Path("dense"), Path())
"""Where photos and reconstruction lie side by side, relative to the data, in this order."""

TEST_FRACTION = 0.1
"""Share of photos that is held out where there is no split file."""


@dataclass
class PhotoTourismDataParserConfig(OwnSplitConfig):
    """Photo Tourism scene: dense/images, dense/sparse and NeRF-W's split file."""

    _target: type = field(default_factory=lambda: PhotoTourismDataParser)
    images_path: Path = ROOTS[0] / "images"
    """Photos, relative to the data; without this option images beside the reconstruction,
    dense/images or images."""
    colmap_path: Path = ROOTS[0] / "sparse"
    """Reconstruction, relative to the data; without this option dense/sparse or sparse, or the
    largest model in there (sparse/0, sparse/1, ...)."""
    split_file: Path | None = None
    """NeRF-W's split file, relative to the data: filename, id, split, with tabs between. Without
    this option the .tsv file in the data or in dense/ that has these columns."""
    test_fraction: float | None = ranged(None, "(0, 1)")
    """Hold out this share of all photos, drawn at random, whatever split files there are. Without
    this option, 0.1 where there is no split file."""
    seed: int = 0
    """Chooses the photos that --test-fraction holds out."""
    downscale_factor: int | None = ranged(None, "[1, inf)")
    """All photos at 1/N of their size. Without this option every photo by itself is halved until it
    has at most 1600 pixels a side; smaller ones keep their size."""


class PhotoTourismDataParser(DeSplatColmapDataParser):
    """See `PhotoTourismDataParserConfig`."""

    config: PhotoTourismDataParserConfig
    sizes_differ = True
    split_by = "the split file, or --test-fraction and --seed"

    def __init__(self, config: PhotoTourismDataParserConfig):
        """Raises as `with_paths`."""
        super().__init__(with_paths(config))

    def lists(self, names: Sequence[str]) -> Lists:
        """By the split file, or drawn; says once how.

        Raises:
            CaptureError: a split file that does not fit, see `split_file`.
        """
        config, fraction, path = self.config, self.config.test_fraction, None
        if fraction is None:
            named = config.split_file
            path = config.data / named if named else find_split_file(split_folders(config.data))
        if path is not None:
            lists, how = read_split_file(path), f"by {path}"
        else:
            lists = draw_split(names, fraction or TEST_FRACTION, config.seed)
            how = "drawn by --test-fraction and --seed"
        train, test = lists["train"], lists["test"]
        announce_once(
            f"Split, {how}: of {len(names)} photos {len(train)} train, and {len(test)} are for "
            f"testing: {list_names(sorted(test))}."
        )
        return lists


def split_folders(data: Path) -> list[Path]:
    """Where a scene's split file may be. Whoever names dense/ itself as the data has it one folder
    up."""
    above = [data / ".."] if data.resolve().name == ROOTS[0].name else []
    return [data, data / ROOTS[0], *above]


def with_paths(config: PhotoTourismDataParserConfig) -> PhotoTourismDataParserConfig:
    """The same with photos and reconstruction side by side in one of `ROOTS`; options come before
    that.

    Photos of one root never go with the reconstruction of the other: there they are undistorted,
    here perhaps not. A root that has both comes before one that has a reconstruction only.

    Raises:
        CaptureError: no such folder, or no reconstruction.
    """
    default, data = PhotoTourismDataParserConfig(), config.data
    images, colmap = config.images_path, config.colmap_path
    pairs = [
        (
            images if images != default.images_path else root / "images",
            colmap if colmap != default.colmap_path else root / "sparse",
        )
        for root in ROOTS
    ]
    found = [pair for pair in pairs if find_models(data, pair[1])]
    found.sort(key=lambda pair: not (data / pair[0]).is_dir())
    if not found:
        looked = ", ".join(dict.fromkeys(colmap.as_posix() for _, colmap in pairs))
        raise CaptureError(
            f"No COLMAP reconstruction in {data} (looked in {looked}, and in folders inside them). "
            "Needed: cameras, images and points3D as .bin or .txt, beside a folder `images`. Name "
            "the scene's folder with --data, or the reconstruction with --colmap-path and the "
            "photos with --images-path, relative to --data."
        )
    return replace(config, images_path=found[0][0], colmap_path=found[0][1])


photo_tourism_dataparser = DataParserSpecification(
    config=PhotoTourismDataParserConfig(),
    description="Photo Tourism scene: dense/images, dense/sparse, NeRF-W's split file.",
)
