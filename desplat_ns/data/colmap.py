"""COLMAP captures for nerfstudio: its `colmap` dataparser, read with pycolmap and without prompts.

Letters in shapes: n photos, P points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from nerfstudio.cameras import camera_utils
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs
from nerfstudio.data.dataparsers.colmap_dataparser import ColmapDataParser, ColmapDataParserConfig
from nerfstudio.data.scene_box import SceneBox
from torch import Tensor

from desplat_ns.console import announce
from desplat_ns.data.checks import check_cameras, check_files, without_infinite_points
from desplat_ns.data.colmap_model import Frame, Points, Reconstruction, read_reconstruction
from desplat_ns.data.downscale import PhotoSource, downscale_factor, photo_sources
from desplat_ns.errors import CaptureError, ConfigError

_LIST_FILES = {
    "train": ("train",),
    "val": ("val", "validation", "test"),
    "test": ("test", "val", "validation"),
}
"""`<name>_list.txt` files that say which photos a split has, the first that exists."""

FAR = 100.0
"""Captures that lie nearer, in units of their spread, keep every bit of nerfstudio's arithmetic,
which costs them 1e-5 of the spread at most."""


@dataclass
class DeSplatColmapDataParserConfig(ColmapDataParserConfig):
    """nerfstudio's COLMAP captures; finds the reconstruction, reduces photos while reading."""

    _target: type = field(default_factory=lambda: DeSplatColmapDataParser)
    colmap_path: Path = Path("sparse")
    """Reconstruction, relative to the data: a model's folder, or a folder of models (sparse/0,
    sparse/1, ...) of which the one with most photos is taken. colmap/sparse is found too."""


def with_pycolmap(config: ColmapDataParserConfig) -> DeSplatColmapDataParserConfig:
    """The same options for our parser; nerfstudio's default `colmap_path` becomes a search."""
    options = {f.name: getattr(config, f.name) for f in fields(config) if f.name != "_target"}
    if options["colmap_path"] == ColmapDataParserConfig().colmap_path:
        options["colmap_path"] = Path("colmap/sparse")
    return DeSplatColmapDataParserConfig(**options)


@dataclass(frozen=True)
class OrientedPoses:
    """Camera poses as nerfstudio trains on them, and how they got there."""

    camera_to_worlds: Float[Tensor, "n 3 4"]
    """OpenGL axes, oriented, centred and scaled."""
    local_transform: Float[Tensor, "3 4"]
    """COLMAP's world, with `origin` subtracted, to the oriented world, before scaling."""
    scale: float
    origin: np.ndarray
    """[3], float64: 0 unless COLMAP's world lies far out (see `far_origin`)."""

    @property
    def transform(self) -> Float[Tensor, "3 4"]:
        """COLMAP's world to the oriented world, before scaling; float32, as nerfstudio has it."""
        if not self.origin.any():
            return self.local_transform
        exact = self.local_transform.double()
        exact[:, 3] -= exact[:, :3] @ torch.from_numpy(self.origin)
        return exact.float()


class DeSplatColmapDataParser(ColmapDataParser):
    """Reads a COLMAP capture once for all splits. See `DeSplatColmapDataParserConfig`."""

    config: DeSplatColmapDataParserConfig
    _last_note: str = ""

    @cached_property
    def images_path(self) -> Path:
        """Folder of the photos, relative to the data."""
        return self.config.images_path

    @cached_property
    def colmap_path(self) -> Path:
        """Where the reconstruction is looked for, relative to the data."""
        return self.config.colmap_path

    @cached_property
    def reconstruction(self) -> Reconstruction:
        """The COLMAP model.

        Raises:
            CaptureError: see `read_reconstruction`; or one photo only, or no points.
        """
        config = self.config
        found = read_reconstruction(config.data, self.colmap_path)
        if len(found.frames) < 2:
            raise CaptureError(
                f"The reconstruction {found.folder} has one photo only ({found.frames[0].name}); "
                "two or more are needed, better 20. Take more and run COLMAP again."
            )
        if config.load_3D_points and len(found.points.xyz) == 0:
            raise CaptureError(
                f"The reconstruction {found.folder} has no 3D points to start from. Run COLMAP's "
                "point_triangulator, or add --load-3D-points False to start from random points."
            )
        return found

    @cached_property
    def oriented(self) -> OrientedPoses:
        """Poses of all photos with a pose, before any split."""
        return orient_poses(self.reconstruction.frames, self.config)

    def sources(self, frames: Sequence[Frame]) -> list[PhotoSource]:
        """Files of these photos and the sizes at which they are used; says once whence.

        Raises:
            CaptureError: photos that are not there.
        """
        config = self.config
        images = config.data / self.images_path
        factor = downscale_factor(config.downscale_factor, self.reconstruction.frames)
        sources, note = photo_sources(images, frames, factor, config.downscale_rounding_mode)
        check_files([source.path for source in sources], images, "photos", "--images-path")
        if note and note != self._last_note:
            announce(note)
        self._last_note = note
        return sources

    def views(self, names: Sequence[str], split: str) -> list[int]:
        """Indices into `names` (photos inside the images folder) of a split; nerfstudio's rules.

        Raises:
            CaptureError: a list file or file name that does not fit, or no photo for the split.
        """
        listed = [
            name
            for name in _LIST_FILES.get(split, ())
            if (self.config.data / f"{name}_list.txt").exists()
        ]
        folder = self.config.data / self.images_path
        paths = [folder / name for name in names]
        try:
            picked = self._get_image_indices(paths, listed[0] if listed else split)
        except (RuntimeError, ValueError) as error:
            raise CaptureError(
                f"The {split} photos of {self.config.data} cannot be chosen: {error} Check the "
                "*_list.txt files there, or --eval-mode."
            ) from error
        if len(picked) == 0:
            raise CaptureError(
                f"None of the {len(names)} photos of {self.config.data} is left for the {split} "
                "split. Check the *_list.txt files there, or --eval-mode and its numbers."
            )
        return [int(i) for i in picked]

    def metadata_of(self, frames: Sequence[Frame]) -> dict[str, Any]:
        """What goes into the outputs' metadata for these photos, beside points."""
        depths = _side_files(self.config.data, self.config.depths_path, frames)
        if depths is not None:
            check_files(depths[1], depths[0], "depth maps", "--depths-path")
        return {
            "depth_filenames": depths[1] if depths is not None else None,
            "depth_unit_scale_factor": self.config.depth_unit_scale_factor,
        }

    def _generate_dataparser_outputs(self, split: str = "train", **kwargs: Any):
        frames = self.reconstruction.frames
        indices = self.views([frame.name for frame in frames], split)
        chosen = [frames[i] for i in indices]
        sources = self.sources(chosen)
        oriented = self.oriented
        masks = _side_files(self.config.data, self.config.masks_path, chosen)
        if masks is not None:
            check_files(masks[1], masks[0], "masks", "--masks-path")
        metadata = self.metadata_of(chosen)
        if self.config.load_3D_points:
            metadata.update(self._points_metadata())
        half = self.config.scene_scale
        cameras = make_cameras(chosen, sources, oriented.camera_to_worlds[indices])
        check_cameras(cameras, [frame.name for frame in chosen], self.reconstruction.folder)
        return DataparserOutputs(
            image_filenames=[source.path for source in sources],
            cameras=cameras,
            scene_box=SceneBox(aabb=torch.tensor([[-half] * 3, [half] * 3], dtype=torch.float32)),
            mask_filenames=masks[1] if masks is not None else None,
            dataparser_scale=oriented.scale,
            dataparser_transform=oriented.transform,
            metadata=metadata,
        )

    def _points_metadata(self) -> dict[str, Tensor]:
        if self.config.max_2D_matches_per_3D_point != 0:
            raise ConfigError(
                "--max-2D-matches-per-3D-point is not used by desplat; leave it at 0."
            )
        oriented = self.oriented
        found = points_metadata(
            self.reconstruction.points, oriented.local_transform, oriented.scale, oriented.origin
        )
        return without_infinite_points(found, self.reconstruction.folder)


def orient_poses(frames: Sequence[Frame], config: ColmapDataParserConfig) -> OrientedPoses:
    """COLMAP's poses turned, centred and scaled by nerfstudio's options."""
    applied = np.eye(4)
    if config.assume_colmap_world_coordinate_convention:
        # COLMAP's guess of gravity (-y) to nerfstudio's up (+z): (x, y, z) -> (x, z, -y).
        applied = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=float)
    world_to_camera = np.tile(np.eye(4), (len(frames), 1, 1))
    world_to_camera[:, :3] = [frame.world_to_camera for frame in frames]
    camera_to_world = np.linalg.inv(world_to_camera)
    origin = np.zeros(3)
    if config.center_method != "none":
        origin = far_origin(camera_to_world[:, :3, 3])
    camera_to_world[:, :3, 3] -= origin
    camera_to_world[:, :3, 1:3] *= -1  # OpenCV's axes to OpenGL's
    poses, transform = camera_utils.auto_orient_and_center_poses(
        torch.from_numpy((applied @ camera_to_world).astype(np.float32)),
        method=config.orientation_method,
        center_method=config.center_method,
    )
    scale = config.scale_factor
    if config.auto_scale_poses:
        farthest = float(poses[:, :3, 3].abs().max())
        if farthest == 0.0:
            raise CaptureError(
                f"All photos of {config.data} were taken from the same point; a scene needs views "
                "from different places. Add --auto-scale-poses False if that is what you want."
            )
        scale /= farthest
    poses[:, :3, 3] *= scale
    transform = transform @ torch.from_numpy(applied).to(transform.dtype)
    return OrientedPoses(poses[:, :3, :4], transform, scale, origin)


def far_origin(places: np.ndarray) -> np.ndarray:
    """The middle of places [n, 3] that lie FAR times their spread from the origin, else 0.

    It is subtracted while numbers are still float64: float32 has a quarter of a metre left for
    what lies 3,000 km out (geo-referenced captures).
    """
    middle = places.mean(axis=0)
    is_far = np.abs(middle).max() > FAR * np.abs(places - middle).max()
    return middle if is_far else np.zeros(3)


def points_metadata(
    points: Points,
    transform: Float[Tensor, "3 4"],
    scale: float,
    origin: np.ndarray | float = 0.0,
) -> dict[str, Tensor]:
    """Points in the oriented, scaled world, under the keys that nerfstudio's models read.

    Args:
        transform: of places from which `origin` was subtracted, before scaling.
    """
    xyz = torch.from_numpy((points.xyz - origin).astype(np.float32))
    return {
        "points3D_xyz": (xyz @ transform[:, :3].T + transform[:, 3]) * scale,
        "points3D_rgb": torch.from_numpy(points.rgb),
        "points3D_error": torch.from_numpy(points.error.astype(np.float32)),
        "points3D_num_points2D": torch.from_numpy(points.num_views),
    }


def make_cameras(
    frames: Sequence[Frame], sources: Sequence[PhotoSource], poses: Float[Tensor, "n 3 4"]
) -> Cameras:
    """Cameras at the sizes at which the photos are used.

    Focal lengths and principal points are scaled by new over old width and height, exactly:
    nerfstudio scales by 1/factor even where the size was rounded.
    """
    x_ratio = torch.tensor([s.width / f.width for f, s in zip(frames, sources, strict=True)])
    y_ratio = torch.tensor([s.height / f.height for f, s in zip(frames, sources, strict=True)])

    def per_photo(name: str) -> Tensor:
        return torch.tensor([frame.intrinsics.get(name, 0.0) for frame in frames])

    distortion = [per_photo(name) for name in ("k1", "k2", "k3", "k4", "p1", "p2")]
    return Cameras(
        camera_to_worlds=poses,
        fx=per_photo("fx") * x_ratio,
        fy=per_photo("fy") * y_ratio,
        cx=per_photo("cx") * x_ratio,
        cy=per_photo("cy") * y_ratio,
        width=torch.tensor([source.width for source in sources]),
        height=torch.tensor([source.height for source in sources]),
        distortion_params=torch.stack(distortion, dim=-1),
        camera_type=torch.tensor([[frame.camera_type.value] for frame in frames]),
    )


def true_masks(folder: Path, frames: Sequence[Frame]) -> dict[str, list[Path | None]]:
    """Metadata `distractor_mask_filenames`: the mask of each photo, None where it has none.

    Empty where no photo has one. A mask is a .png with the photo's name below `folder`, white where
    a distractor is. Evaluation compares the model's masks with them; training never sees them.
    """
    paths = [folder / Path(frame.name).with_suffix(".png") for frame in frames]
    masks = [path if path.is_file() else None for path in paths]
    return {"distractor_mask_filenames": masks} if any(masks) else {}


def _side_files(
    data: Path, folder: Path | None, frames: Sequence[Frame]
) -> tuple[Path, list[Path]] | None:
    """The folder and the .png file beside each photo (masks, depth maps), None where not asked."""
    if folder is None:
        return None
    return data / folder, [data / folder / Path(f.name).with_suffix(".png") for f in frames]
