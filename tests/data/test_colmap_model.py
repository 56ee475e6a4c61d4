"""COLMAP models are found, the largest is taken, and what cannot be used is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import PIL.Image  # noqa: F401  before pycolmap, see desplat_ns.data.colmap_model
import pycolmap
import pytest
from nerfstudio.cameras.cameras import CameraType

from desplat_ns.data import colmap_model
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.colmap_model import find_models, read_reconstruction
from desplat_ns.data.tracks import METADATA_KEY
from desplat_ns.errors import CaptureError

SPARSE = Path("sparse")


def test_text_comes_in_as_written(capture):
    data = capture(["b.png", "folder/a.png"])
    model = read_reconstruction(data, SPARSE)
    assert model.folder == data / "sparse" / "0"
    assert [(f.name, f.image_id) for f in model.frames] == [("b.png", 1), ("folder/a.png", 2)]
    second = model.frames[1]
    expected = np.concatenate([np.eye(3), [[-1], [0], [0]]], axis=1)
    np.testing.assert_array_equal(second.world_to_camera, expected)
    assert (second.width, second.height) == (8, 6)
    assert second.camera_type == CameraType.PERSPECTIVE
    assert second.intrinsics == {"fx": 10.0, "fy": 11.0, "cx": 4.0, "cy": 3.0}
    np.testing.assert_array_equal(model.points.xyz, [[0.5, -1, 4], [1, 2, 3]])
    np.testing.assert_array_equal(model.points.rgb, [[10, 20, 30], [200, 100, 50]])


def test_a_reconstruction_is_parsed_once_until_a_file_of_it_changes(
    capture, monkeypatch: pytest.MonkeyPatch
):
    data, parsed = capture(), []
    parse = colmap_model._read_model
    monkeypatch.setattr(
        colmap_model, "_read_model", lambda folder: parsed.append(folder) or parse(folder)
    )
    first, same = (read_reconstruction(data, place) for place in (SPARSE, SPARSE / "0"))
    assert len(parsed) == 1
    np.testing.assert_array_equal(first.points.xyz, same.points.xyz)
    points = data / "sparse" / "0" / "points3D.txt"
    points.write_text(points.read_text().replace("0.5 -1 4", "0.5 -1 5"))
    assert read_reconstruction(data, SPARSE).points.xyz[0].tolist() == [0.5, -1, 5]


def test_binary_equals_text(capture, tmp_path: Path):
    data = capture()
    binary = tmp_path / "binary" / "sparse" / "0"
    binary.mkdir(parents=True)
    pycolmap.Reconstruction(data / "sparse" / "0").write_binary(binary)
    text, same = (read_reconstruction(d, SPARSE) for d in (data, tmp_path / "binary"))
    assert [f.name for f in text.frames] == [f.name for f in same.frames]
    for frame, other in zip(text.frames, same.frames, strict=True):
        np.testing.assert_array_equal(frame.world_to_camera, other.world_to_camera)
        assert frame.intrinsics == other.intrinsics
    np.testing.assert_array_equal(text.points.xyz, same.points.xyz)


@pytest.mark.parametrize("place", ["sparse", "sparse/0", "sparse/2", "colmap/sparse/0"])
def test_the_usual_places_are_searched(tmp_path: Path, model_writer, place: str):
    model_writer(tmp_path / place, ["a.png", "b.png"])
    assert find_models(tmp_path, SPARSE) == [tmp_path / place]


def test_a_named_model_is_taken_even_if_another_is_larger(tmp_path: Path, model_writer):
    model_writer(tmp_path / "mine", ["a.png", "b.png"])
    model_writer(tmp_path / "sparse" / "0", ["a.png", "b.png", "c.png"])
    assert read_reconstruction(tmp_path, Path("mine")).folder == tmp_path / "mine"


def test_the_largest_of_several_is_taken_and_said(tmp_path: Path, model_writer, capsys):
    for name, count in (("0", 2), ("1", 4), ("2", 3)):
        model_writer(tmp_path / "sparse" / name, [f"{i}.png" for i in range(count)])
    assert len(read_reconstruction(tmp_path, SPARSE).frames) == 4
    said = capsys.readouterr().out
    assert f"{tmp_path / 'sparse' / '1'} with 4 photos, the largest of 3" in said
    assert "0: 2, 2: 3" in said
    assert said.count("\n") == 1


def binary_with(data: Path, change: Callable[[pycolmap.Reconstruction], object]) -> None:
    """Turn the text model of a capture into a binary one after a change."""
    folder = data / "sparse" / "0"
    model = pycolmap.Reconstruction(folder)
    change(model)
    for file in folder.iterdir():
        file.unlink()
    model.write_binary(folder)


def test_points_with_nan_are_left_out_and_counted(capture, capsys):
    data = capture()
    binary_with(data, lambda model: setattr(model.points3D[1], "xyz", [np.nan, 0, 0]))
    outputs = DeSplatColmapDataParserConfig(data=data).setup().get_dataparser_outputs("train")
    assert outputs.metadata["points3D_xyz"].isfinite().all()
    assert outputs.metadata["points3D_rgb"].tolist() == [[200, 100, 50]]
    assert outputs.metadata[METADATA_KEY].point_ids.tolist() == [2]
    assert "1 of 2 points" in capsys.readouterr().out


def test_nan_in_a_text_file_which_colmap_cannot_read_is_shown(capture):
    data = capture(points=["1 nan 0 0 1 2 3 0.5 1 0", "2 1 2 3 4 5 6 0.5 1 1"])
    with pytest.raises(CaptureError, match=r"1 lines of points3D\.txt .*the first: 1 nan 0 0"):
        read_reconstruction(data, SPARSE)


def test_a_pose_with_nan_is_named(capture):
    data = capture()
    nowhere = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([np.nan, 0, 0]))
    binary_with(data, lambda model: setattr(model.frames[2], "rig_from_world", nowhere))
    with pytest.raises(CaptureError, match=r"Photo b\.png .*NaN"):
        read_reconstruction(data, SPARSE)


@pytest.mark.parametrize(
    ("camera", "expected", "kind"),
    [
        ("SIMPLE_PINHOLE 8 6 10 4 3", {"fx": 10, "fy": 10}, CameraType.PERSPECTIVE),
        ("SIMPLE_RADIAL 8 6 10 4 3 0.1", {"fy": 10, "k1": 0.1}, CameraType.PERSPECTIVE),
        ("RADIAL 8 6 10 4 3 0.1 0.2", {"k1": 0.1, "k2": 0.2}, CameraType.PERSPECTIVE),
        (
            "OPENCV 8 6 10 11 4 3 0.1 0.2 0.3 0.4",
            {"fx": 10, "fy": 11, "k1": 0.1, "k2": 0.2, "p1": 0.3, "p2": 0.4},
            CameraType.PERSPECTIVE,
        ),
        (
            "OPENCV_FISHEYE 8 6 10 11 4 3 0.1 0.2 0.3 0.4",
            {"k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4},
            CameraType.FISHEYE,
        ),
    ],
)
def test_camera_models_give_their_parameters_by_name(capture, camera, expected, kind):
    frame = read_reconstruction(capture(cameras=[f"1 {camera}"]), SPARSE).frames[0]
    assert expected.items() <= frame.intrinsics.items()
    assert frame.camera_type == kind


def test_an_unsupported_camera_is_named(capture):
    data = capture(cameras=["1 FOV 8 6 10 10 4 3 0.5"])
    with pytest.raises(CaptureError, match=r"model FOV; supported are .*colmap image_undistorter"):
        read_reconstruction(data, SPARSE)


def test_no_reconstruction_says_where_it_was_looked_for(tmp_path: Path):
    with pytest.raises(CaptureError, match=r"looked in sparse, colmap/sparse.*--colmap-path"):
        read_reconstruction(tmp_path, SPARSE)
    with pytest.raises(CaptureError, match=r"looked in mine\)"):
        read_reconstruction(tmp_path, Path("mine"))
    with pytest.raises(CaptureError, match=r"nowhere does not exist.*--data"):
        read_reconstruction(tmp_path / "nowhere", SPARSE)


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
def test_a_damaged_model_is_named(tmp_path: Path, model_writer, part: str):
    text = model_writer(tmp_path / "text", [f"{i}.png" for i in range(3)])
    model = tmp_path / "data" / "sparse" / "0"
    model.mkdir(parents=True)
    pycolmap.Reconstruction(text).write_binary(model)
    for extra in ("rigs.bin", "frames.bin"):  # older COLMAPs write none, so nothing checks the rest
        (model / extra).unlink(missing_ok=True)
    file = model / f"{part}.bin"
    file.write_bytes(b"\x05" + file.read_bytes()[1:20])
    with pytest.raises(CaptureError, match="sparse/0 cannot be read"):
        read_reconstruction(tmp_path / "data", SPARSE)


def test_a_model_without_posed_photos_is_named(capture):
    data = capture(points=[])
    (data / "sparse" / "0" / "images.txt").write_text("")
    with pytest.raises(CaptureError, match="no photo with a pose"):
        read_reconstruction(data, SPARSE)


@pytest.fixture
def binary(capture) -> Path:
    """A capture whose model is binary, of two points."""
    data = capture()
    model = data / "sparse" / "0"
    pycolmap.Reconstruction(model).write_binary(model)
    for path in model.glob("*.txt"):
        path.unlink()
    return data


@pytest.mark.parametrize("at", [0, 8 + 43], ids=["points", "observations"])
@pytest.mark.parametrize("count", [1, 2**40, 2**63])
def test_a_damaged_count_of_points_is_an_error_and_no_endless_loop(binary: Path, at, count):
    path = binary / "sparse" / "0" / "points3D.bin"
    data = bytearray(path.read_bytes())
    data[at : at + 8] = count.to_bytes(8, "little")
    path.write_bytes(data)
    with pytest.raises(CaptureError, match=r"cannot be read: points3D\.bin has"):
        read_reconstruction(binary, SPARSE)


@pytest.mark.parametrize("left", [0, 8, 40, -1])
def test_a_file_of_points_that_was_cut_off_is_an_error(binary: Path, left):
    path = binary / "sparse" / "0" / "points3D.bin"
    path.write_bytes(path.read_bytes()[:left])
    with pytest.raises(CaptureError, match=r"cannot be read: points3D\.bin has"):
        read_reconstruction(binary, SPARSE)


@pytest.mark.parametrize("size", ["0 6", "18446744073709551615 6", "8 70000"])
def test_a_camera_without_a_possible_size_is_named(capture, size):
    data = capture(cameras=[f"1 PINHOLE {size} 10 11 4 3"])
    with pytest.raises(CaptureError, match=r"pixels; a side has 1 to"):
        read_reconstruction(data, SPARSE)
