"""Cameras and points whose place cannot be are left out and named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from nerfstudio.cameras.cameras import CameraType

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.photo_files import check_files
from desplat_ns.data.point_cloud import Points
from desplat_ns.data.poses import OrientedPoses, points_metadata, without_far_photos
from desplat_ns.data.reconstruction import TRACKS, Frame, Reconstruction


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


def ring(count: int) -> list[np.ndarray]:
    """Places around the origin, at a distance of 4."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return [4 * np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in angles]


def looking(places: list[np.ndarray], focal: float = 100.0) -> list[Frame]:
    """Cameras of 100 x 80 pixels at these places that look at the origin."""
    frames = []
    for number, place in enumerate(places):
        ahead = -place / np.linalg.norm(place)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.column_stack([np.stack([right, np.cross(ahead, right), ahead]), np.zeros(3)])
        pose[:, 3] = -pose[:, :3] @ place
        lens = {"fx": focal, "fy": focal, "cx": 50.0, "cy": 40.0}
        number, kind = 100 * len(places) + number, CameraType.PERSPECTIVE
        frames.append(Frame(f"{number}.jpg", number, pose, kind, 100, 80, lens))
    return frames


def known_of(frames: list[Frame], num_points: int = 200) -> Reconstruction:
    xyz = np.random.default_rng(0).normal(size=(num_points, 3))
    points = Points(xyz, np.zeros((num_points, 3), np.uint8), np.arange(num_points))
    return Reconstruction(Path("x"), frames, points)


@pytest.mark.parametrize("num_points", [200, 0])
@pytest.mark.parametrize("extents", [25, 100, 1e6])
def test_cameras_far_off_are_left_out_and_named(extents: float, num_points: int, capsys):
    right, wrong = looking(ring(20)), looking([8 * extents * place for place in ring(7)][:3])
    known = without_far_photos(known_of([*right, *wrong], num_points))
    assert known.frames == right
    said = capsys.readouterr().out
    assert "3 of 23 photos" in said and all(frame.name in said for frame in wrong)


@pytest.mark.parametrize(
    "frames",
    [
        looking(ring(20)),
        # along a line, from which one looks back
        looking([np.array([0.5 + x, 0.1, 0.0]) for x in range(0, 900, 30)]),
        # a few through a long lens, from a hundred times as far
        [*looking(ring(20)), *looking([100 * place for place in ring(7)][:3], focal=10_000.0)],
        # most on a tripod
        looking([np.array([4.0, 0.0, 0.0])] * 12 + ring(5)),
    ],
)
def test_photos_from_far_away_that_show_the_points_stay(frames: list[Frame]):
    assert without_far_photos(known_of(frames)).frames == frames


def test_two_groups_of_photos_far_from_one_another_stay():
    near, offset = known_of(looking(ring(14)), 400), np.array([4000.0, 0.0, 0.0])
    there = []
    for frame in looking(ring(6)):
        pose = frame.world_to_camera.copy()
        pose[:, 3] -= pose[:, :3] @ offset
        there.append(replace(frame, world_to_camera=pose))
    xyz = near.points.xyz.copy()
    xyz[200:] += offset
    both = replace(near, frames=near.frames + there, points=replace(near.points, xyz=xyz))
    assert without_far_photos(both).frames == both.frames


def test_all_missing_files_are_counted_at_once_or_their_folder_is_named(tmp_path: Path):
    (tmp_path / "0.png").touch()
    paths = [tmp_path / f"{i}.png" for i in range(13)]
    with pytest.raises(CaptureError, match=r"12 of 13 .*1\.png, 2\.png.* 2 more.*--images-path"):
        check_files(paths, tmp_path, "photos", "--images-path")
    with pytest.raises(CaptureError, match=r"nowhere.*--masks-path"):
        check_files([tmp_path / "nowhere" / "0.png"], tmp_path / "nowhere", "masks", "--masks-path")
