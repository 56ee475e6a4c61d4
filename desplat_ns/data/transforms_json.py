"""nerfstudio's `nerfstudio-data` captures, without its prompt and with points from COLMAP."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs
from nerfstudio.data.dataparsers.nerfstudio_dataparser import Nerfstudio
from torch import Tensor

from desplat_ns.console import announce_once
from desplat_ns.data.checks import check_files, how_to_get_poses
from desplat_ns.data.colmap_model import find_models
from desplat_ns.data.poses import check_cameras, points_metadata, without_infinite_points
from desplat_ns.data.reconstruction import read_reconstruction
from desplat_ns.errors import CaptureError

_UPSTREAM_ERRORS = (
    OSError, AssertionError, LookupError, RuntimeError, ValueError, TypeError, AttributeError,
    ArithmeticError,
)  # fmt: skip
"""What upstream raises, one way or another, for contents that it did not expect."""


class PromptFreeNerfstudio(Nerfstudio):
    """As upstream, but where `transforms.json` names no point cloud and COLMAP's model is there,
    upstream 1.1.5 asks whether to rewrite the capture; this reads the points and writes nothing.

    Point clouds are read with trimesh: upstream's open3d takes seconds to import and needs system
    libraries (libusb, libGL) that a bare machine lacks.
    Photos without an `images_N` copy are taken at full size; the dataset reduces them.
    """

    def _generate_dataparser_outputs(self, split: str = "train") -> DataparserOutputs:
        self.prompted_user, self.create_pc = True, False
        try:
            outputs = super()._generate_dataparser_outputs(split)
        except _UPSTREAM_ERRORS as error:
            raise CaptureError(self._explain(error)) from error
        where = f"`file_path` in {self._transforms()}"
        check_files(outputs.image_filenames, self._folder(), "photos", where)
        names = [path.name for path in outputs.image_filenames]
        check_cameras(outputs.cameras, names, self._transforms())
        if self.config.load_3D_points:
            _check_points(outputs, self._folder())
        return outputs

    def _load_3D_points(
        self, ply_file_path: Path, transform_matrix: Tensor, scale_factor: float
    ) -> dict[str, Tensor] | None:
        """Points of a PLY file in the oriented, scaled world; None where it has none."""
        import trimesh  # it brings a hundred modules, which only such captures need

        cloud = trimesh.load(ply_file_path, process=False)
        if not isinstance(cloud, (trimesh.PointCloud, trimesh.Trimesh)) or not len(cloud.vertices):
            return None
        xyz = torch.from_numpy(np.array(cloud.vertices, dtype=np.float32))
        colors = cloud.colors if isinstance(cloud, trimesh.PointCloud) else None
        if colors is None or len(colors) != len(xyz):
            colors = np.full((len(xyz), 3), 128)
        return {
            "points3D_xyz": (xyz @ transform_matrix[:, :3].T + transform_matrix[:, 3])
            * scale_factor,
            "points3D_rgb": torch.from_numpy(np.array(colors, dtype=np.uint8)[:, :3]),
        }

    def _get_fname(
        self, filepath: Path, data_dir: Path, downsample_folder_prefix: str = "images_"
    ) -> Path:
        reduced = super()._get_fname(filepath, data_dir, downsample_folder_prefix)
        return reduced if reduced.exists() else data_dir / filepath

    def _folder(self) -> Path:
        data = self.config.data
        return data.parent if data.suffix == ".json" else data

    def _transforms(self) -> Path:
        data = self.config.data
        return data if data.suffix == ".json" else data / "transforms.json"

    def _explain(self, error: Exception) -> str:
        data = self.config.data
        if self._transforms().is_file():
            return f"The capture {data} cannot be used: {type(error).__name__}: {error}."
        message = f"The capture {data} has no transforms.json. "
        if not find_models(data, Path("sparse")):
            return f"{message}Check --data. {how_to_get_poses(Path('PHOTOS'))}"
        return message + (
            "It has a COLMAP reconstruction: add the dataparser at the end of the command, "
            f"`colmap --data {data}` (or `robustnerf-data --data {data}` for clean, clutter and "
            "extra in the file names)."
        )


def _check_points(outputs: DataparserOutputs, folder: Path) -> None:
    """Leave only finite points; where there are none, take COLMAP's or say that there are none."""
    xyz = outputs.metadata.get("points3D_xyz")
    if xyz is None:
        try:
            points = read_reconstruction(folder, Path("colmap/sparse/0")).points
        except CaptureError:
            points = None
        if points is not None and len(points.xyz) > 0:
            transform, scale = outputs.dataparser_transform, outputs.dataparser_scale
            outputs.metadata.update(points_metadata(points, transform, scale))
        else:
            announce_once(f"{folder} names no 3D points: training starts at random.", warning=True)
        return
    outputs.metadata = without_infinite_points(outputs.metadata, folder)
    if len(outputs.metadata["points3D_xyz"]) == 0:
        raise CaptureError(
            f"No 3D point named in {folder / 'transforms.json'} has finite coordinates. Make the "
            "point cloud again, or add --load-3D-points False to start from random points."
        )
