"""`nerfstudio-data` never asks, and starts from COLMAP's points where it can."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rich.prompt
import torch
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig

from desplat_ns.data.dataset import CaptureDataset
from desplat_ns.data.transforms_json import TransformsDataParser
from desplat_ns.errors import CaptureError


@pytest.fixture
def processed(tmp_path: Path, photo_writer) -> Path:
    """A capture as an old ns-process-data left it: transforms.json without a point cloud."""
    frames = []
    for i in range(4):
        pose = np.eye(4)
        pose[0, 3] = i
        photo_writer(tmp_path / "images" / f"{i}.png", seed=i)
        frames.append({"file_path": f"images/{i}.png", "transform_matrix": pose.tolist()})
    meta = {"fl_x": 10, "fl_y": 10, "cx": 4, "cy": 3, "w": 8, "h": 6, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(meta))
    return tmp_path


def outputs_of(data: Path, split: str = "train", **options):
    options = {"load_3D_points": True, "_target": TransformsDataParser, **options}
    return NerfstudioDataParserConfig(data=data, **options).setup().get_dataparser_outputs(split)


def test_colmaps_points_are_used_without_a_question(processed, model_writer, monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("asked a question")

    monkeypatch.setattr(rich.prompt.Confirm, "ask", never)
    model_writer(processed / "colmap" / "sparse" / "0", ["0.png", "1.png"])
    before = (processed / "transforms.json").read_bytes()
    outputs = outputs_of(
        processed, orientation_method="none", center_method="none", auto_scale_poses=False
    )
    # Upstream's transform for old captures: COLMAP's (x, y, z) are (y, x, -z) in transforms.json.
    expected = torch.tensor([[-1.0, 0.5, -4.0], [2.0, 1.0, -3.0]])
    torch.testing.assert_close(outputs.metadata["points3D_xyz"], expected)
    assert (processed / "transforms.json").read_bytes() == before


def test_without_any_points_that_is_said(processed: Path, capsys):
    assert "points3D_xyz" not in outputs_of(processed).metadata
    assert "names no 3D points" in capsys.readouterr().out


def test_a_downscale_factor_needs_no_folder_of_copies(processed: Path):
    dataset = CaptureDataset(outputs_of(processed, downscale_factor=2))
    dataset.check_photos()
    assert dataset.get_data(0)["image"].shape == (3, 4, 3)


def test_a_capture_without_transforms_says_what_to_type(tmp_path: Path, capture):
    with pytest.raises(CaptureError, match=r"transforms\.json.*desplat-process"):
        outputs_of(tmp_path)
    with pytest.raises(CaptureError, match=r"transforms\.json.*`colmap --data "):
        outputs_of(capture())


def test_photos_that_are_not_there_are_named(processed: Path):
    (processed / "images" / "2.png").unlink()
    with pytest.raises(CaptureError, match=r"1 of 4 photos .*: images/2\.png"):
        outputs_of(processed)


def damage(data: Path, **changes) -> None:
    meta = json.loads((data / "transforms.json").read_text())
    (data / "transforms.json").write_text(json.dumps({**meta, **changes}))


FRAME = {"file_path": "images/0.png", "transform_matrix": (np.eye(4) * np.nan).tolist()}


@pytest.mark.parametrize(
    "changes",
    [
        *({"fl_x": float("nan")}, {"fl_y": 0}, {"cx": 1e39}, {"w": -8}),
        *({"fl_x": {}}, {"frames": 1.5}, {"w": None}, {"frames": [3]}, {"frames": [FRAME] * 4}),
    ],
    ids=str,
)
def test_a_camera_or_pose_that_cannot_be_is_an_error_that_names_the_capture(
    processed: Path, changes
):
    damage(processed, **changes)
    with pytest.raises(CaptureError, match=str(processed)):
        outputs_of(processed, orientation_method="none", center_method="none")


def test_a_file_that_was_cut_off_is_named(processed: Path):
    (processed / "transforms.json").write_text("{")
    with pytest.raises(CaptureError, match=str(processed)):
        outputs_of(processed)


def name_ply(data: Path, vertices: str, count: int) -> None:
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    )
    (data / "p.ply").write_text(header + "end_header\n" + vertices)
    meta = json.loads((data / "transforms.json").read_text())
    (data / "transforms.json").write_text(json.dumps({**meta, "ply_file_path": "p.ply"}))


def test_points_of_a_ply_go_with_the_cameras(processed: Path):
    name_ply(processed, "0 0 0 1 2 3\n3 0 0 4 5 6\n", 2)
    outputs = outputs_of(processed)
    # The first and the last camera stand at x = 0 and x = 3 of the file.
    cameras = outputs_of(processed, eval_mode="all").cameras.camera_to_worlds[[0, 3], :, 3]
    torch.testing.assert_close(outputs.metadata["points3D_xyz"], cameras)
    assert outputs.metadata["points3D_rgb"].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_points_of_a_ply_with_nan_are_left_out_and_some_have_to_be_left(processed: Path, capsys):
    name_ply(processed, "nan 0 0 1 2 3\n1 2 3 4 5 6\n", 2)
    outputs = outputs_of(processed)
    assert outputs.metadata["points3D_xyz"].shape == (1, 3)
    assert outputs.metadata["points3D_rgb"].tolist() == [[4, 5, 6]]
    assert "1 of 2 points in" in capsys.readouterr().out
    name_ply(processed, "nan 0 0 1 2 3\n", 1)
    with pytest.raises(CaptureError, match="--load-3D-points"):
        outputs_of(processed)


def test_an_empty_or_missing_ply_means_no_points(processed: Path, capsys):
    name_ply(processed, "", 0)
    assert "points3D_xyz" not in outputs_of(processed).metadata
    (processed / "p.ply").unlink()
    with pytest.raises(CaptureError, match=r"p\.ply"):
        outputs_of(processed)
