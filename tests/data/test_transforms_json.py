"""`nerfstudio-data` never asks, and starts from COLMAP's points where it can."""

import json
from pathlib import Path

import numpy as np
import pytest
import rich.prompt
import torch
from nerfstudio.cameras.cameras import CameraType
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.dataset import CaptureDataset, photo_reader
from desplat_ns.data.transforms_json import TransformsDataParser
from tests.helpers.files import write_transforms


@pytest.fixture
def processed(tmp_path: Path, photo_writer) -> Path:
    """A capture as an old ns-process-data left it: transforms.json without a point cloud."""
    for i in range(4):
        photo_writer(tmp_path / "images" / f"{i}.png", seed=i)
    return write_transforms(tmp_path, [f"{i}.png" for i in range(4)])


AS_GIVEN = {"orientation_method": "none", "center_method": "none", "auto_scale_poses": False}


def outputs_of(data: Path, split: str = "train", **options):
    everything = {"load_3D_points": True, "eval_mode": "all", "_target": TransformsDataParser}
    options = everything | options
    return NerfstudioDataParserConfig(data=data, **options).setup().get_dataparser_outputs(split)


def test_colmaps_points_are_used_without_a_question_and_moved_as_the_poses_were(
    processed, model_writer, monkeypatch
):
    def never(*args, **kwargs):
        raise AssertionError("asked a question")

    monkeypatch.setattr(rich.prompt.Confirm, "ask", never)
    model_writer(processed / "colmap" / "sparse" / "0", ["0.png", "1.png"])
    before = (processed / "transforms.json").read_bytes()
    outputs = outputs_of(processed, **AS_GIVEN)
    # An old ns-process-data swapped x with y and turned z.
    expected = torch.tensor([[-1.0, 0.5, -4.0], [2.0, 1.0, -3.0]])
    torch.testing.assert_close(outputs.metadata["points3D_xyz"], expected)
    assert (processed / "transforms.json").read_bytes() == before
    applied = [[0, 0, 1, 5], [1, 0, 0, 6], [0, 1, 0, 7]]
    damage(processed, applied_transform=applied, applied_scale=2)
    expected = torch.tensor([[18.0, 13, 12], [16, 14, 18]])
    torch.testing.assert_close(outputs_of(processed, **AS_GIVEN).metadata["points3D_xyz"], expected)


def test_of_few_photos_one_is_held_out(processed: Path):
    """nerfstudio's 90%, rounded up, would be all four."""
    splits = {s: outputs_of(processed, s, eval_mode="fraction") for s in ("train", "val", "test")}
    names = {s: [path.name for path in of.image_filenames] for s, of in splits.items()}
    assert names["train"] == ["0.png", "1.png", "3.png"]
    assert names["val"] == names["test"] == ["2.png"]


def test_without_any_points_that_is_said(processed: Path, capsys):
    assert "points3D_xyz" not in outputs_of(processed).metadata
    assert "names no 3D points" in capsys.readouterr().out


def test_a_capture_without_transforms_is_named(capture):
    with pytest.raises(CaptureError, match=r"transforms\.json"):
        outputs_of(capture())


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


def name_ply(data: Path, vertices: str, count: int) -> None:
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    )
    (data / "p.ply").write_text(header + "end_header\n" + vertices)
    damage(data, ply_file_path="p.ply")


def test_points_of_a_ply_go_with_the_cameras(processed: Path):
    name_ply(processed, "0 0 0 1 2 3\n3 0 0 4 5 6\n", 2)
    outputs = outputs_of(processed)
    # The first and the last camera stand at x = 0 and x = 3 of the file.
    cameras = outputs_of(processed, eval_mode="all").cameras.camera_to_worlds[[0, 3], :, 3]
    torch.testing.assert_close(outputs.metadata["points3D_xyz"], cameras)
    assert outputs.metadata["points3D_rgb"].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_a_ply_has_to_be_there_and_some_points_have_to_be_left(processed: Path):
    damage(processed, ply_file_path="p.ply")
    with pytest.raises(CaptureError, match=r"p\.ply cannot be read"):
        outputs_of(processed)
    name_ply(processed, "nan 0 0 1 2 3\n", 1)
    with pytest.raises(CaptureError, match="--load-3D-points"):
        outputs_of(processed)


def rewrite(data: Path, change) -> None:
    """Change every frame, given its number."""
    frames = json.loads((data / "transforms.json").read_text())["frames"]
    for number, frame in enumerate(frames):
        change(number, frame)
    damage(data, frames=frames)


def test_a_frames_own_numbers_come_before_those_of_the_head(processed: Path):
    rewrite(processed, lambda number, frame: frame.update(fl_x=20 + number, w=8, k1=0.1 * number))
    cameras = outputs_of(processed, eval_mode="all").cameras
    assert cameras.fx.flatten().tolist() == [20, 21, 22, 23]
    assert cameras.fy.flatten().tolist() == [10] * 4
    torch.testing.assert_close(cameras.distortion_params[:, 0], torch.arange(4) * 0.1)


@pytest.mark.parametrize(
    "head",
    [
        {"is_fisheye": True, "k4": 0.1},
        {"camera_model": "OPENCV_FISHEYE"},
        {"camera_type": "fisheye", "is_latlong": False},
        {"camera_model": "Opencv_Fisheye", "is_fisheye": True},
    ],
)
def test_a_fisheye_of_any_program_is_one_also_without_terms(processed: Path, head):
    damage(processed, **head, fl_x=6, fl_y=6)
    dataset = CaptureDataset(outputs_of(processed, eval_mode="all"))
    straight = dataset.get_numpy_image(0)
    bent = photo_reader(dataset)(0)["image"].numpy()
    assert dataset.cameras.camera_type.unique().tolist() == [CameraType.FISHEYE.value]
    assert bent.shape != straight.shape or (bent != straight).any()


@pytest.mark.parametrize(
    ("head", "named"),
    [
        *(
            ({"camera_model": model}, model)
            for model in ("EQUIRECTANGULAR", "FISHEYE624", "VR180_L", "ORTHOPHOTO", "FULL_OPENCV")
        ),
        ({"latlong": True}, "LATLONG"),
        ({"is_equirectangular": 1}, "EQUIRECTANGULAR"),
        ({"ftheta_p0": 0.1, "ftheta_p1": 0.2}, "FTHETA"),
        ({"camera_type": "omnidirectionalstereo_l"}, "OMNIDIRECTIONALSTEREO_L"),
        ({"camera_model": "PINHOLE", "is_fisheye": True}, "FISHEYE and PINHOLE"),
        ({"k4": 0.1}, "OPENCV_FISHEYE"),
        ({"cx": 1e9}, "cannot be"),
    ],
)
def test_cameras_that_cannot_be_drawn_are_an_error(processed: Path, head, named: str):
    damage(processed, **head)
    with pytest.raises(CaptureError, match=named):
        outputs_of(processed)


def test_a_lens_of_a_single_frame_is_looked_at_and_plain_names_of_pinholes_are_known(
    processed: Path,
):
    rewrite(processed, lambda number, frame: frame.update(camera_type="perspective"))
    assert outputs_of(processed).cameras.camera_type.unique().tolist() == [1]
    rewrite(processed, lambda number, frame: frame.update({"latlong": True} if number == 2 else {}))
    with pytest.raises(CaptureError, match=r"2\.png.*LATLONG"):
        outputs_of(processed)


def test_copies_are_found_below_their_folders_only(processed: Path, photo_writer):
    for side in ("left", "right"):
        photo_writer(processed / "images" / side / "0.png", seed=len(side))
    photo_writer(processed / "images_2" / "0.png", 4, 3)
    sides = ("left", "right", "left", "right")
    rewrite(processed, lambda i, f: f.update(file_path=f"images/{sides[i]}/0.png"))
    meta = json.loads((processed / "transforms.json").read_text())
    damage(processed, frames=meta["frames"][:2])
    outputs = outputs_of(processed, eval_mode="all", downscale_factor=2)
    assert len(set(outputs.image_filenames)) == 2
    photo_writer(processed / "images_2" / "left" / "0.png", 4, 3)
    photo_writer(processed / "images_2" / "right" / "0.png", 4, 3)
    outputs = outputs_of(processed, eval_mode="all", downscale_factor=2)
    assert outputs.image_filenames[1] == processed / "images_2" / "right" / "0.png"


@pytest.mark.parametrize("key", ["mask_path", "mask_filename"])
def test_masks_are_named_by_either_key_and_in_every_frame(processed: Path, photo_writer, key: str):
    photo_writer(processed / "m.png")
    rewrite(processed, lambda _, frame: frame.update({key: "m.png"}))
    assert outputs_of(processed, eval_mode="all").mask_filenames == [processed / "m.png"] * 4
    rewrite(processed, lambda number, frame: frame.update({key: "m.png" * (number > 0)}))
    with pytest.raises(CaptureError, match="mask_path"):
        outputs_of(processed)


def test_what_other_programs_write_is_read(processed: Path):
    """An angle for a focal length, no size, 3 x 4 poses, backslashes, a byte order mark."""

    def change(number: int, frame: dict) -> None:
        frame["transform_matrix"].pop()
        frame["file_path"] = f"images\\{number}.png"

    rewrite(processed, change)
    meta = json.loads((processed / "transforms.json").read_text())
    text = json.dumps({"camera_angle_x": 2 * np.arctan(0.5), "frames": meta["frames"]})
    (processed / "transforms.json").write_text(text, "utf-8-sig")
    cameras = outputs_of(processed).cameras
    found = [float(getattr(cameras, name)[0]) for name in ("fx", "fy", "cx", "cy", "width")]
    np.testing.assert_allclose(found, [8, 8, 4, 3, 8])


def test_poses_with_rows_and_columns_swapped_are_named(processed: Path):
    def turn(number: int, frame: dict) -> None:
        if number == 2:
            frame["transform_matrix"] = np.array(frame["transform_matrix"]).T.tolist()

    rewrite(processed, turn)
    with pytest.raises(CaptureError, match=r"frames\[2\].*last row"):
        outputs_of(processed)
