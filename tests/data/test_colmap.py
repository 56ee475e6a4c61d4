"""Our COLMAP parser gives what nerfstudio's gives, without its prompt."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
import torch
from nerfstudio.data.dataparsers.colmap_dataparser import ColmapDataParserConfig
from scipy.spatial import KDTree

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig, with_pycolmap
from desplat_ns.data.reconstruction import TRACKS

CAMERA_FIELDS = ("camera_to_worlds", "fx", "fy", "cx", "cy", "width", "height")
CAMERA_FIELDS += ("distortion_params", "camera_type")
TOLERANCE: dict[str, Any] = {"rtol": 1e-5, "atol": 1e-5}
"""Upstream turns quaternions into matrices itself; then some dozen operations in float32."""

OPTIONS = [
    {},
    {"orientation_method": "none", "center_method": "none", "auto_scale_poses": False},
    {"orientation_method": "pca", "center_method": "focus", "scale_factor": 2.0},
    {"assume_colmap_world_coordinate_convention": False, "orientation_method": "vertical"},
    {"eval_mode": "fraction", "train_split_fraction": 0.8},
]


def in_order_of(other: dict, metadata: dict) -> dict[str, torch.Tensor]:
    """The points of `metadata`, each where `other` has the one of that place and colour."""
    ours, theirs = (
        torch.cat([meta["points3D_xyz"], meta["points3D_rgb"]], dim=1) for meta in (metadata, other)
    )
    assert ours.shape == theirs.shape
    order = KDTree(ours).query(theirs)[1]
    return {key: value[order] for key, value in metadata.items() if key.startswith("points3D")}


def assert_same_outputs(data: Path, **options) -> None:
    upstream = ColmapDataParserConfig(
        data=data, colmap_path=Path("sparse/0"), downscale_factor=1, **options
    ).setup()
    ours = DeSplatColmapDataParserConfig(data=data, downscale_factor=1, **options).setup()
    for split in ("train", "val", "test"):
        theirs, other = (parser.get_dataparser_outputs(split) for parser in (upstream, ours))
        assert theirs.image_filenames == other.image_filenames
        for name in CAMERA_FIELDS:
            mine, wanted = (getattr(outputs.cameras, name) for outputs in (other, theirs))
            torch.testing.assert_close(mine, wanted, **TOLERANCE)
        mine, wanted = other.dataparser_transform, theirs.dataparser_transform
        torch.testing.assert_close(mine, wanted, **TOLERANCE)
        assert other.dataparser_scale == pytest.approx(theirs.dataparser_scale, rel=1e-5)
        torch.testing.assert_close(other.scene_box.aabb, theirs.scene_box.aabb)
        unread = {"points3D_error", "points3D_num_points2D"}
        unread |= {"depth_filenames", "depth_unit_scale_factor"}
        assert {*theirs.metadata, TRACKS} - unread == set(other.metadata)
        for key, value in in_order_of(other.metadata, theirs.metadata).items():
            if key not in unread:
                torch.testing.assert_close(other.metadata[key], value, **TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_outputs_equal_upstreams_on_a_generated_scene(tiny_scene, options):
    assert_same_outputs(tiny_scene.folder, **options)


def test_cameras_scale_by_the_rounded_size(capture):
    data = capture(cameras=["1 PINHOLE 9 7 10 11 4.5 3.5"])
    outputs = DeSplatColmapDataParserConfig(data=data, downscale_factor=2).setup()
    camera = outputs.get_dataparser_outputs("train").cameras[0]
    assert (camera.width.item(), camera.height.item()) == (4, 3)
    # 10 * 4/9, 11 * 3/7; the principal point stays in the middle.
    assert camera.fx.item() == pytest.approx(40 / 9)
    assert camera.fy.item() == pytest.approx(33 / 7)
    assert (camera.cx.item(), camera.cy.item()) == pytest.approx((2.0, 1.5))


def outputs_of(data: Path, split: str = "train", **options: Any):
    return DeSplatColmapDataParserConfig(data=data, **options).setup().get_dataparser_outputs(split)


def test_upstreams_default_path_becomes_a_search(tmp_path: Path):
    swapped = with_pycolmap(ColmapDataParserConfig(data=tmp_path, eval_interval=3))
    assert isinstance(swapped, DeSplatColmapDataParserConfig)
    assert (swapped.data, swapped.eval_interval) == (tmp_path, 3)
    assert swapped.colmap_path == Path("colmap/sparse")
    named = with_pycolmap(ColmapDataParserConfig(colmap_path=Path("mine")))
    assert named.colmap_path == Path("mine")


def test_list_files_decide_the_splits_and_test_stands_in_for_val(capture, capsys):
    data = capture()
    (data / "train_list.txt").write_text("a.png\nc.png\n")
    (data / "test_list.txt").write_text("b.png\n")
    names = {
        split: [path.name for path in outputs_of(data, split).image_filenames]
        for split in ("train", "val", "test")
    }
    assert names == {"train": ["a.png", "c.png"], "val": ["b.png"], "test": ["b.png"]}
    (data / "train_list.txt").write_text("nothing.png\n")
    with pytest.raises(CaptureError, match=r"is left for the train split.*_list\.txt"):
        outputs_of(data)
    assert "1 of 1 photos" in (said := capsys.readouterr().out) and "nothing.png" in said


@pytest.mark.parametrize(
    ("options", "error", "named"),
    [
        ({"images_path": Path("pictures")}, CaptureError, "pictures.*--images-path"),
        ({"masks_path": Path("masks")}, CaptureError, "masks.*--masks-path"),
        ({"downscale_factor": 0}, ConfigError, "--downscale-factor"),
    ],
)
def test_options_that_do_not_fit_are_named(capture, options: dict, error: type, named: str):
    with pytest.raises(error, match=named):
        outputs_of(capture(), **options)


def test_masks_that_lie_there_unused_are_mentioned_with_their_option(capture, capsys):
    data = capture()
    outputs_of(data)
    assert "masks" not in capsys.readouterr().out
    (data / "masks").mkdir()
    outputs_of(data)
    assert "--masks-path masks" in capsys.readouterr().out


def test_no_points_is_an_error_unless_random_ones_are_asked_for(capture):
    data = capture(points=[])
    with pytest.raises(CaptureError, match="--load-3D-points False"):
        outputs_of(data)
    assert "points3D_xyz" not in outputs_of(data, load_3D_points=False).metadata


def test_one_photo_or_one_standpoint_is_not_a_scene(capture):
    with pytest.raises(CaptureError, match=r"a\.png"):
        outputs_of(capture(["a.png"], points=["1 0.5 -1 4 10 20 30 0.25 1 0"]))
    data = capture(["a.png", "b.png"])
    file = data / "sparse" / "0" / "images.txt"
    file.write_text(file.read_text().replace("-1 0 0 1 b.png", "0 0 0 1 b.png"))
    with pytest.raises(CaptureError, match="--auto-scale-poses"):
        outputs_of(data)


OUT = np.array([1.2e6, -3.4e6, 250.0])
"""Metres: a national grid's coordinates."""


def moved_out(source: Path, target: Path, offset: np.ndarray) -> Path:
    """The same capture with its world's origin elsewhere."""
    shutil.copytree(source, target)
    (model,) = {path.parent for path in target.rglob("cameras.*")}
    reconstruction = pycolmap.Reconstruction(str(model))
    reconstruction.transform(pycolmap.Sim3d(1.0, pycolmap.Rotation3d(), offset))
    reconstruction.write(str(model))
    return target


@pytest.mark.parametrize("center", ["poses", "focus"])
def test_a_geo_referenced_capture_is_as_sharp_as_one_at_the_origin(tiny_scene, tmp_path, center):
    near, far = (
        DeSplatColmapDataParserConfig(data=data, downscale_factor=1, center_method=center)
        .setup()
        .get_dataparser_outputs("train")
        for data in (tiny_scene.folder, moved_out(tiny_scene.folder, tmp_path / "far", OUT))
    )
    # Cameras lie within 1 of the origin. In float32, 3.4e6 metres would be rounded to 0.25.
    moved, value = (outputs.cameras.camera_to_worlds for outputs in (far, near))
    assert torch.allclose(moved, value, rtol=0, atol=1e-5)
    for name in ("points3D_xyz", "points3D_rgb"):
        moved, value = (outputs.metadata[name].double() for outputs in (far, near))
        assert torch.allclose(moved, value, rtol=1e-4, atol=1e-4), name
    turn, shift = near.dataparser_transform[:, :3].double(), near.dataparser_transform[:, 3]
    want = shift.double() - turn @ torch.from_numpy(OUT)
    assert torch.allclose(far.dataparser_transform[:, 3].double(), want, rtol=1e-5)
