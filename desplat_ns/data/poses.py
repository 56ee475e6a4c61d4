"""From a reconstruction's frames and points to the cameras and points that training uses.

Letters in shapes: n photos.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from nerfstudio.cameras import camera_utils
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.dataparsers.colmap_dataparser import ColmapDataParserConfig
from torch import Tensor

from desplat_ns.core.console import announce_once, list_names
from desplat_ns.core.errors import CaptureError
from desplat_ns.data.downscale import PhotoSource
from desplat_ns.data.reconstruction import TRACKS, Frame, Reconstruction, Tracks

FAR = 30
"""Median distances from the middle of all cameras; ten captures reach 2.9, and one in a line 2."""
LEAST_SHOWN, LEAST_FILLED = 8, 0.1
"""Points, and the part of a photo's width or height, by which a camera far off is right."""


@dataclass(frozen=True)
class OrientedPoses:
    """Camera poses as nerfstudio trains on them, and how they got there."""

    camera_to_worlds: Float[Tensor, "n 3 4"]
    """OpenGL axes, oriented, centred and scaled."""
    transform: Float[Tensor, "3 4"]
    """The reconstruction's world to the oriented world, before scaling; in float64."""
    scale: float


def orient_poses(known: Reconstruction, config: ColmapDataParserConfig) -> OrientedPoses:
    """Poses turned, centred and scaled by nerfstudio's options. Their middle is taken off in
    float64: float32 has steps of 0.25 m where a geo-referenced capture lies 3,000 km out."""
    applied = np.eye(4)
    if config.assume_colmap_world_coordinate_convention and not known.is_upright:
        # COLMAP's guess of gravity (-y) to nerfstudio's up (+z): (x, y, z) -> (x, z, -y).
        applied = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=float)
    camera_to_world = camera_to_worlds(known.frames)
    middle = camera_to_world[:, :3, 3].mean(axis=0) * (config.center_method != "none")
    camera_to_world[:, :3, 3] -= middle
    camera_to_world[:, :3, 1:3] *= -1  # OpenCV's axes to OpenGL's
    poses, transform = camera_utils.auto_orient_and_center_poses(
        torch.from_numpy((applied @ camera_to_world).astype(np.float32)),
        method=known.orientation or config.orientation_method,  # pyright: ignore[reportArgumentType]
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
    transform = transform.double() @ torch.from_numpy(applied)
    transform[:, 3] -= transform[:, :3] @ torch.from_numpy(middle)
    return OrientedPoses(poses[:, :3, :4], transform, scale)


def without_far_photos(known: Reconstruction) -> Reconstruction:
    """The same without photos whose poses must be wrong, of which it is said which: the scene is
    scaled by its farthest camera.

    Such a camera is `FAR` times as far from the middle of all cameras as the median one, and points
    do not fill `LEAST_FILLED` of its photo. Where there are no points, less than a quarter go.
    """
    frames, xyz = known.frames, known.points.xyz
    centres = camera_to_worlds(frames)[:, :3, 3]
    off = np.linalg.norm(centres - np.median(centres, axis=0), axis=1)
    usual = np.median(off)
    far = [i for i in np.flatnonzero(off > FAR * usual) if not _shows(frames[i], xyz)]
    if not far or usual == 0 or (len(xyz) == 0 and 4 * len(far) >= len(frames)):
        return known
    announce_once(
        f"{len(far)} of {len(frames)} photos in {known.folder} are left out. Their cameras are "
        f"{FAR} times and more as far off as the others are and show nothing of the points: their "
        f"poses must be wrong. They are {list_names(frames[i].name for i in far)}.",
        warning=True,
    )
    return replace(known, frames=[frame for i, frame in enumerate(frames) if i not in far])


def _shows(frame: Frame, xyz: Float[np.ndarray, "P 3"]) -> bool:
    """Whether points fill a part of a photo, without the outermost, as a pinhole would show it."""
    x, y, depth = frame.world_to_camera @ np.concatenate([xyz.T, np.ones((1, len(xyz)))])
    lens, sides = frame.intrinsics, [[frame.width], [frame.height]]
    with np.errstate(all="ignore"):
        at = np.stack([lens["fx"] * x, lens["fy"] * y]) / depth + [[lens["cx"]], [lens["cy"]]]
    at = at[:, (depth > 0) & (at > 0).all(axis=0) & (at < sides).all(axis=0)] / sides
    if at.shape[1] < LEAST_SHOWN:
        return False
    return bool(np.ptp(np.quantile(at, (0.1, 0.9), axis=1), axis=0).max() > LEAST_FILLED)


def camera_to_worlds(frames: Sequence[Frame]) -> Float[np.ndarray, "n 4 4"]:
    """Poses in OpenCV axes, in the reconstruction's world and units."""
    world_to_camera = np.tile(np.eye(4), (len(frames), 1, 1))
    world_to_camera[:, :3] = [frame.world_to_camera for frame in frames]
    return np.linalg.inv(world_to_camera)


def points_metadata(
    known: Reconstruction, oriented: OrientedPoses, frames: Sequence[Frame]
) -> dict[str, Any]:
    """Points in the oriented, scaled world, under the keys that nerfstudio's models read, and their
    `Tracks`; without those whose place is not finite, of which it is said how many."""
    points, transform = known.points, oriented.transform
    xyz = torch.from_numpy(points.xyz) @ transform[:, :3].T + transform[:, 3]
    xyz = (oriented.scale * xyz).float()
    keep = xyz.isfinite().all(dim=-1)
    if not bool(keep.all()):
        announce_once(
            f"{int((~keep).sum())} of {len(xyz)} points in {known.folder} have NaN, infinite or "
            "too large coordinates and are left out.",
            warning=True,
        )
    metadata: dict[str, Any] = {"points3D_xyz": xyz[keep]}
    metadata["points3D_rgb"] = torch.from_numpy(points.rgb)[keep]
    if known.has_tracks:
        photos = tuple(frame.image_id for frame in frames)
        metadata[TRACKS] = Tracks(known.folder, photos, points.ids[keep.numpy()])
    return metadata


def make_cameras(
    frames: Sequence[Frame], sources: Sequence[PhotoSource], poses: Float[Tensor, "n 3 4"]
) -> Cameras:
    """Cameras at the sizes at which the photos are used. Intrinsics are scaled by new over old
    width and height: nerfstudio scales by 1/factor even where the size was rounded."""
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
