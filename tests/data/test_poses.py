"""Cameras and points that cannot be are named, or left out."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import torch
from nerfstudio.cameras.cameras import CameraType

from desplat_ns.data.photo_files import check_files
from desplat_ns.data.point_cloud import Points
from desplat_ns.data.poses import OrientedPoses, points_metadata
from desplat_ns.data.reconstruction import TRACKS, Frame, Reconstruction, check_frame
from desplat_ns.errors import CaptureError

IMPOSSIBLE = (
    {"fx": np.nan}, {"fy": 0.0}, {"fx": -1.0}, {"cx": np.inf}, {"cy": 1e9}, {"width": 0},
    {"height": 70000},
)  # fmt: skip


@pytest.mark.parametrize("changes", [{}, *IMPOSSIBLE])
def test_a_camera_that_cannot_be_is_named(changes):
    numbers = {"fx": 10.0, "fy": 10.0, "cx": 4.0, "cy": 3.0, "width": 8, "height": 6, **changes}
    sides = numbers.pop("width"), numbers.pop("height")
    frame = Frame("b", 1, np.eye(4)[:3], CameraType.PERSPECTIVE, *sides, numbers)
    with pytest.raises(CaptureError, match="Photo b in x") if changes else nullcontext():
        check_frame(frame, Path("x"))


def test_points_that_are_not_finite_are_left_out_with_what_belongs_to_them(capsys):
    xyz = np.array([[0.0, 0, 0], [np.inf, 0, 0], [1, 1, 1]])
    points = Points(xyz, np.arange(9, dtype=np.uint8).reshape(3, 3), np.array([3, 5, 8]))
    known = Reconstruction(Path("x"), [], points, has_tracks=True)
    oriented = OrientedPoses(torch.zeros(0, 3, 4), torch.eye(4).double()[:3], 2.0)
    kept = points_metadata(known, oriented, [])
    assert kept["points3D_xyz"].tolist() == [[0, 0, 0], [2, 2, 2]]
    assert kept["points3D_rgb"].tolist() == [[0, 1, 2], [6, 7, 8]]
    assert kept[TRACKS].point_ids.tolist() == [3, 8]
    assert "1 of 3 points in x" in capsys.readouterr().out


def test_all_missing_files_are_counted_at_once_or_their_folder_is_named(tmp_path: Path):
    (tmp_path / "0.png").touch()
    paths = [tmp_path / f"{i}.png" for i in range(13)]
    with pytest.raises(CaptureError, match=r"12 of 13 .*1\.png, 2\.png.* 2 more.*--images-path"):
        check_files(paths, tmp_path, "photos", "--images-path")
    with pytest.raises(CaptureError, match=r"nowhere.*--masks-path"):
        check_files([tmp_path / "nowhere" / "0.png"], tmp_path / "nowhere", "masks", "--masks-path")
