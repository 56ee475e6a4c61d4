"""Photo Tourism scenes: COLMAP's undistorted photos and NeRF-W's split."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.console import announce_once
from desplat_ns.data.colmap import DeSplatColmapDataParser, OwnSplitConfig
from desplat_ns.data.colmap_model import find_models
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.photo_tourism.split_file import (
    PhotoSplit,
    draw_split,
    find_split_file,
    read_split_file,
)

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
    test_fraction: float | None = None
    """Hold out this share of all photos, drawn at random, whatever split files there are. Without
    this option, 0.1 where there is no split file."""
    seed: int = 0
    """Chooses the photos that --test-fraction holds out."""
    downscale_factor: int | None = None
    """All photos at 1/N of their size. Without this option every photo by itself is halved until it
    has at most 1600 pixels a side; smaller ones keep their size."""
    distractor_masks_path: Path | None = Path("masks")
    """Folder of true distractor masks (white = distractor), relative to the data, if there is one.
    Evaluation compares the model's masks with them; training never sees them."""


class PhotoTourismDataParser(DeSplatColmapDataParser):
    """See `PhotoTourismDataParserConfig`."""

    config: PhotoTourismDataParserConfig
    sizes_differ = True

    def __init__(self, config: PhotoTourismDataParserConfig):
        """Raises as `with_paths`."""
        super().__init__(with_paths(config))

    @cached_property
    def split(self) -> PhotoSplit:
        """Training and test photos of the reconstruction; says once how they were chosen.

        Raises:
            CaptureError: a split file that does not fit, see `split_file`.
            ConfigError: options that contradict each other, or are out of range.
        """
        config, fraction = self.config, self.config.test_fraction
        names = [frame.name for frame in self.reconstruction.frames]
        if config.split_file is not None and fraction is not None:
            raise ConfigError(
                f"--split-file {config.split_file} and --test-fraction {fraction} contradict each "
                "other; give one of them."
            )
        path = None if config.split_file is None else config.data / config.split_file
        if path is None and fraction is None:
            path = find_split_file(split_folders(config.data))
        if path is not None:
            split = read_split_file(path, names)
            unlisted = len(names) - len(split.train) - len(split.test)
            more = f" {unlisted} more in the reconstruction are not listed: not used."
            how = f"by {path}", more * bool(unlisted)
        else:
            split = draw_split(names, TEST_FRACTION if fraction is None else fraction, config.seed)
            drawn = ", ".join(names[i] for i in split.test)
            how = "drawn by --test-fraction and --seed", f" Those for testing: {drawn}."
        announce_once(
            f"Split, {how[0]}: {len(split.train)} photos train, {len(split.test)} test.{how[1]}"
        )
        return split

    def views(self, names: Sequence[str], split: str) -> list[int]:
        """Indices of the training photos or, for any other split, of the test photos."""
        return self.split.train if split == "train" else self.split.test


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
