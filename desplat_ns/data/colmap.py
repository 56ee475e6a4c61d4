"""COLMAP captures for nerfstudio: its `colmap` dataparser, by pycolmap and without prompts."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import torch
import tyro
from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig, DataparserOutputs
from nerfstudio.data.dataparsers.colmap_dataparser import ColmapDataParser, ColmapDataParserConfig
from nerfstudio.data.scene_box import SceneBox

from desplat_ns.core.console import announce_once, list_names
from desplat_ns.core.errors import CaptureError
from desplat_ns.core.options import check_ranges, ranged
from desplat_ns.data.downscale import photo_sources
from desplat_ns.data.photo_files import check_files
from desplat_ns.data.poses import (
    OrientedPoses,
    make_cameras,
    orient_poses,
    points_metadata,
    without_far_photos,
)
from desplat_ns.data.reconstruction import Frame, Reconstruction, read_reconstruction
from desplat_ns.data.splits import Lists, listed_photos, read_list_files

_Hidden = tyro.conf.Suppress

GT_MASKS = "distractor_mask_filenames"
"""Metadata of a split: files of the photos' true masks, None where a photo has none; absent where
all have none. A mask is a .png with the photo's name, white where a distractor is."""


@dataclass
class DeSplatColmapDataParserConfig(ColmapDataParserConfig):
    """nerfstudio's COLMAP captures; finds the reconstruction, reduces photos while reading."""

    _target: type = field(default_factory=lambda: DeSplatColmapDataParser)
    colmap_path: Path = Path("sparse")
    """Reconstruction, relative to the data: a model's folder, or a folder of models (sparse/0,
    sparse/1, ...) of which the one with most photos is taken. colmap/sparse is found too."""
    downscale_factor: int | None = ranged(None, "[1, inf)")
    """All photos at 1/N of their size. Without this option every photo by itself is halved until it
    has at most 1600 pixels a side; smaller ones keep their size."""
    distractor_masks_path: Path | None = None
    """Folder of true distractor masks (white = distractor), relative to the data, if there is one.
    Evaluation compares the model's masks with them; training never sees them."""


@dataclass
class OwnSplitConfig(DeSplatColmapDataParserConfig):
    """COLMAP captures that say themselves which photos are held out."""

    distractor_masks_path: Path | None = Path("masks")
    """Folder of true distractor masks (white = distractor), relative to the data, if there is one.
    Evaluation compares the model's masks with them; training never sees them."""

    eval_mode: Annotated[Literal["fraction", "filename", "interval", "all"], _Hidden] = "filename"
    """Not used: the capture decides."""
    train_split_fraction: Annotated[float, _Hidden] = 0.9
    """Not used: the capture decides."""
    eval_interval: Annotated[int, _Hidden] = 8
    """Not used: the capture decides."""


def with_pycolmap(config: DataParserConfig, **changes: Any) -> DeSplatColmapDataParserConfig:
    """What a parser of nerfstudio shares with ours, for ours, with `changes`; nerfstudio's default
    `colmap_path` becomes a search."""
    ours = {f.name for f in fields(DeSplatColmapDataParserConfig)} - {"_target"}
    options = {f.name: getattr(config, f.name) for f in fields(config) if f.name in ours} | changes
    if options.get("colmap_path") == ColmapDataParserConfig().colmap_path:
        options["colmap_path"] = Path("colmap/sparse")
    return DeSplatColmapDataParserConfig(**options)


class DeSplatColmapDataParser(ColmapDataParser):
    """Reads a COLMAP capture once for all splits. See `DeSplatColmapDataParserConfig`."""

    config: DeSplatColmapDataParserConfig
    split_by: ClassVar[str] = "--eval-mode and its numbers, or by the *_list.txt files there"
    """What says which photos are held out."""

    def __init__(self, config: DeSplatColmapDataParserConfig):
        """Raises ConfigError: a number outside of its range."""
        super().__init__(config)
        check_ranges(config)

    def read(self) -> Reconstruction:
        """The COLMAP model. Raises as `read_reconstruction`."""
        return read_reconstruction(self.config.data, self.config.colmap_path)

    @cached_property
    def reconstruction(self) -> Reconstruction:
        """What is known of the capture. Raises CaptureError as `read`, and without points."""
        model = without_far_photos(self.read())
        if self.config.load_3D_points:
            is_finite = np.isfinite(model.points.xyz).all(axis=1)
            if not is_finite.any() and (len(is_finite) or not model.is_upright):
                raise CaptureError(
                    f"The reconstruction {model.folder} has no 3D points to start from. Make them "
                    "(COLMAP's point_triangulator does), or add --load-3D-points False to start "
                    "from random points."
                )
        return model

    @cached_property
    def photos_folder(self) -> Path:
        """In which the reconstruction's names of photos are."""
        return self.reconstruction.photos or self.config.data / self.config.images_path

    @cached_property
    def oriented(self) -> OrientedPoses:
        """Poses of all photos with a pose, before any split."""
        return orient_poses(self.reconstruction, self.config)

    def masks(self, frames: Sequence[Frame]) -> list[Path] | None:
        """Files that say where these photos may be used, named a.png or a.jpg.png for a.jpg. Raises
        CaptureError where some are not there."""
        folder, option = self.config.data, "`mask_path` in every frame of transforms.json"
        named = [frame.mask or folder / "no mask_path" / frame.name for frame in frames]
        if self.config.masks_path is not None:
            folder, option = folder / self.config.masks_path, "--masks-path"
            whole = [folder / f"{frame.name}.png" for frame in frames]
            short = [folder / Path(frame.name).with_suffix(".png") for frame in frames]
            named = [a if a.is_file() else b for a, b in zip(whole, short, strict=True)]
        elif all(frame.mask is None for frame in frames):
            if (folder / "masks").is_dir() and self.config.distractor_masks_path is None:
                if not self.reconstruction.is_upright:
                    option = "`colmap --masks-path masks` at the end of the command"
                announce_once(
                    f"{folder / 'masks'} is not used. If white is what may be used there, add "
                    f"{option}."
                )
            return None
        check_files(named, folder, "masks", option)
        return named

    def lists(self, names: Sequence[str]) -> Lists:
        """Which of the photos, by their names inside the images folder, each split has; empty where
        nerfstudio's options decide."""
        return self.reconstruction.splits or read_list_files(self.config.data)

    def views(self, split: str) -> list[int]:
        """Indices of a split's photos among the frames of the reconstruction. Raises CaptureError
        where there is none, and as `lists`."""
        data, names = self.config.data, [frame.name for frame in self.reconstruction.frames]
        picked, why = [], ""
        if lists := self.lists(names):
            instead = {"val": "test", "test": "val"}.get(split, split)
            picked = listed_photos(names, lists.get(split) or lists.get(instead, ()), data)
        else:
            try:
                picked = [int(i) for i in self._get_image_indices([*map(Path, names)], split)]
            except ValueError as error:
                why = f": {error}"
        if not picked:
            raise CaptureError(
                f"None of the {len(names)} photos of {data} ({list_names(names)}) is left for the "
                f"{split} split{why}. They are chosen by {self.split_by}."
            )
        return picked

    def _get_image_indices(self, image_filenames: Sequence[Path], split: str) -> Any:
        """nerfstudio's, but for `fraction` of few photos: it rounds up, and of nine or fewer holds
        out none by its default. Here the middle one."""
        count, share = len(image_filenames), self.config.train_split_fraction
        if self.config.eval_mode != "fraction" or share >= 1 or count * share <= count - 1:
            return super()._get_image_indices(image_filenames, split)
        return [i for i in range(count) if (i == count // 2) == (split != "train")]

    def _generate_dataparser_outputs(self, split: str = "train", **kwargs: Any):
        config = self.config
        indices = self.views(split)
        frames = [self.reconstruction.frames[i] for i in indices]
        sources = photo_sources(
            self.photos_folder, frames, config.downscale_factor, config.downscale_rounding_mode
        )
        metadata: dict[str, Any] = {}
        if config.distractor_masks_path is not None:
            folder = config.data / config.distractor_masks_path
            paths = [folder / Path(frame.name).with_suffix(".png") for frame in frames]
            masks = [path if path.is_file() else None for path in paths]
            metadata |= {GT_MASKS: masks} if any(masks) else {}
        if config.load_3D_points and len(self.reconstruction.points.xyz):
            metadata |= points_metadata(self.reconstruction, self.oriented, frames)
        return DataparserOutputs(
            image_filenames=[source.path for source in sources],
            cameras=make_cameras(frames, sources, self.oriented.camera_to_worlds[indices]),
            scene_box=SceneBox(config.scene_scale * torch.tensor([[-1.0] * 3, [1.0] * 3])),
            mask_filenames=self.masks(frames),
            dataparser_scale=self.oriented.scale,
            dataparser_transform=self.oriented.transform.float(),
            metadata=metadata,
        )
