"""Cameras and points that cannot be are named, or left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.data.checks import check_files
from desplat_ns.data.poses import check_cameras, without_infinite_points
from desplat_ns.errors import CaptureError

NAMES = ["a", "b", "c"]


def cameras(**changes: float) -> Cameras:
    """Three cameras, of which the second is changed."""
    numbers = {"fx": 10.0, "fy": 10.0, "cx": 4.0, "cy": 3.0, "width": 8.0, "height": 6.0}
    columns: dict[str, Any] = {key: torch.full((3, 1), value) for key, value in numbers.items()}
    for key, value in changes.items():
        columns[key][1] = value
    columns |= {key: columns[key].long() for key in ("width", "height")}
    return Cameras(torch.eye(4)[:3].repeat(3, 1, 1), **columns)


IMPOSSIBLE = (
    {"fx": torch.nan}, {"fy": 0.0}, {"fx": -1.0}, {"cx": torch.inf}, {"width": 0}, {"height": 70000}
)  # fmt: skip


@pytest.mark.parametrize("changes", IMPOSSIBLE)
def test_a_camera_that_cannot_be_is_named(changes):
    check_cameras(cameras(), NAMES, Path("x"))
    check_cameras(cameras()[:0], [], Path("x"))
    with pytest.raises(CaptureError, match=r"1 of 3 photos in x .*: b\."):
        check_cameras(cameras(**changes), NAMES, Path("x"))


def test_points_that_are_not_finite_are_left_out_with_what_belongs_to_them(capsys):
    metadata = {
        "points3D_xyz": torch.tensor([[0.0, 0, 0], [torch.inf, 0, 0], [1, 1, 1]]),
        "points3D_rgb": torch.arange(9).reshape(3, 3),
        "other": torch.arange(3),
    }
    kept = without_infinite_points(metadata, Path("x"))
    assert kept["points3D_xyz"].shape == (2, 3)
    assert kept["points3D_rgb"].tolist() == [[0, 1, 2], [6, 7, 8]]
    assert kept["other"].tolist() == [0, 1, 2]
    assert "1 of 3 points in x" in capsys.readouterr().out


def test_all_missing_files_are_counted_at_once_or_their_folder_is_named(tmp_path: Path):
    (tmp_path / "0.png").touch()
    paths = [tmp_path / f"{i}.png" for i in range(13)]
    with pytest.raises(CaptureError, match=r"12 of 13 .*1\.png, 2\.png.* 2 more.*--images-path"):
        check_files(paths, tmp_path, "photos", "--images-path")
    with pytest.raises(CaptureError, match=r"nowhere.*--masks-path"):
        check_files([tmp_path / "nowhere" / "0.png"], tmp_path / "nowhere", "masks", "--masks-path")
