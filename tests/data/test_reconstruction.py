"""COLMAP models are found, the largest is taken, and what cannot be used is named; what photos
observe is read from them when it is asked for."""

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from nerfstudio.cameras.cameras import CameraType

from desplat_ns.core.errors import CaptureError
from desplat_ns.data import reconstruction
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.reconstruction import TRACKS, Tracks, read_reconstruction
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig

SPARSE = Path("sparse")


def test_text_and_binary_come_in_as_written(capture):
    data = capture(["b.png", "folder/a.png"])
    for form in ("text", "binary"):
        if form == "binary":
            binary_with(data, lambda model: None)
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


def binary_with(data: Path, change: Callable[[pycolmap.Reconstruction], object]) -> Path:
    """Turn the text model of a capture into a binary one after a change; gives its folder."""
    folder = data / "sparse" / "0"
    model = pycolmap.Reconstruction(folder)
    change(model)
    for file in folder.iterdir():
        file.unlink()
    model.write_binary(folder)
    for extra in ("rigs.bin", "frames.bin"):  # older COLMAPs write none, so nothing checks the rest
        (folder / extra).unlink(missing_ok=True)
    return folder


def test_a_reconstruction_is_parsed_once_until_a_file_of_it_changes(
    capture, monkeypatch: pytest.MonkeyPatch
):
    data, parsed = capture(), []
    parse = reconstruction.read_model
    monkeypatch.setattr(
        reconstruction, "read_model", lambda folder: parsed.append(folder) or parse(folder)
    )
    first, same = (read_reconstruction(data, place) for place in (SPARSE, SPARSE / "0"))
    assert len(parsed) == 1 and first is same
    points = data / "sparse" / "0" / "points3D.txt"
    points.write_text(points.read_text().replace("0.5 -1 4", "0.5 -1 5"))
    assert read_reconstruction(data, SPARSE).points.xyz[0].tolist() == [0.5, -1, 5]


def test_the_largest_of_several_is_taken_and_said_unless_another_is_named(
    tmp_path: Path, model_writer, capsys
):
    for name, count in (("0", 2), ("1", 4), ("2", 3)):
        model_writer(tmp_path / "sparse" / name, [f"{i}.png" for i in range(count)])
    model_writer(tmp_path / "mine", ["a.png", "b.png"])
    assert len(read_reconstruction(tmp_path, SPARSE).frames) == 4
    said = capsys.readouterr().out
    assert str(tmp_path / "sparse" / "1") in said and said.count("\n") == 1
    assert read_reconstruction(tmp_path, Path("mine")).folder == tmp_path / "mine"


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


@pytest.mark.parametrize(
    "camera",
    [
        "FOV 8 6 10 10 4 3 0.5",
        "PINHOLE 0 6 10 11 4 3",
        "PINHOLE 18446744073709551615 6 10 11 4 3",
        "PINHOLE 8 70000 10 11 4 3",
    ],
)
def test_a_camera_that_cannot_be_used_is_named_with_its_photo(capture, camera: str):
    with pytest.raises(CaptureError, match=r"a\.png"):
        read_reconstruction(capture(cameras=[f"1 {camera}"]), SPARSE)


def test_no_reconstruction_says_where_it_was_looked_for(tmp_path: Path):
    with pytest.raises(CaptureError, match=r"sparse, colmap/sparse.*--colmap-path"):
        read_reconstruction(tmp_path, SPARSE)
    with pytest.raises(CaptureError, match=r"nowhere.*--data"):
        read_reconstruction(tmp_path / "nowhere", SPARSE)


def test_a_model_without_posed_photos_or_with_nan_in_text_is_named(capture):
    data = capture(points=[])
    (data / "sparse" / "0" / "images.txt").write_text("")
    with pytest.raises(CaptureError, match="sparse/0"):
        read_reconstruction(data, SPARSE)
    data = capture(points=["1 nan 0 0 1 2 3 0.5 1 0"])
    with pytest.raises(CaptureError, match="sparse/0"):
        read_reconstruction(data, SPARSE)


@pytest.mark.parametrize("name", [b"Gr\xf6\xdfe.png", b"a\nb.png", 300 * b"a"])
def test_a_photo_whose_name_no_file_can_have_is_named(capture, name: bytes):
    path = binary_with(capture(), lambda _: None) / "images.bin"
    before, after = path.read_bytes()[:72], path.read_bytes()[72:]
    path.write_bytes(before + name + after[after.index(b"\0") :])
    with pytest.raises(
        CaptureError, match=r"sparse/0 has the name .*Rename|1 photos .* are not in"
    ):
        DeSplatColmapDataParserConfig(data=path.parents[2]).setup().get_dataparser_outputs("val")


COUNTS, OBSERVED = 0, 8 + 43
"""Where a file of points says how many there are, and how many observations the first has."""


@pytest.mark.parametrize(
    ("part", "damage"),
    [
        ("cameras", lambda content: b"\x05" + content[1:20]),
        ("images", lambda content: b"\x05" + content[1:20]),
        ("images", lambda content: content[: 8 + 64 + 3]),  # in the first photo's name
        *(("points3D", lambda content, n=n: content[:n]) for n in (0, 8, 40, -1)),
        *(
            (
                "points3D",
                lambda content, at=at, count=count: (
                    content[:at] + count.to_bytes(8, "little") + content[at + 8 :]
                ),
            )
            for at in (COUNTS, OBSERVED)
            for count in (1, 2**40, 2**63)
        ),
    ],
)
def test_a_model_that_is_damaged_or_cut_off_is_an_error_and_no_endless_loop(
    capture, part: str, damage: Callable[[bytes], bytes]
):
    data = capture()
    path = binary_with(data, lambda model: None) / f"{part}.bin"
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(CaptureError, match="sparse/0"):
        read_reconstruction(data, SPARSE)


def test_poses_that_are_cut_off_are_an_error_and_no_crash(capture):
    folder = capture() / "sparse" / "0"
    pycolmap.Reconstruction(folder).write_binary(folder)
    for file in folder.glob("*.txt"):
        file.unlink()
    path = folder / "frames.bin"
    path.write_bytes(path.read_bytes()[:-60])
    with pytest.raises(CaptureError, match=r"frames\.bin"):
        read_reconstruction(folder.parents[1], SPARSE)


@pytest.mark.parametrize("form", ["text", "binary"])
def test_points_may_stand_in_a_ply(capture, form: str):
    data = capture()
    if form == "binary":
        binary_with(data, lambda model: None)
    (points,) = (data / "sparse" / "0").glob("points3D.*")
    points.unlink()
    columns = "".join(f"property float {c}\n" for c in ("x", "y", "z", "nx", "ny", "nz"))
    columns += "".join(f"property uchar {c}\n" for c in ("red", "green", "blue"))
    head = f"ply\nformat ascii 1.0\nelement vertex 2\n{columns}end_header\n"
    points.with_suffix(".ply").write_text(head + "1 2 3 0 0 0 7 8 9\n4 5 6 0 0 0 1 2 3\n")
    known = read_reconstruction(data, SPARSE)
    assert known.points.xyz.tolist() == [[1, 2, 3], [4, 5, 6]] and not known.has_tracks
    assert known.points.rgb.tolist() == [[7, 8, 9], [1, 2, 3]]
    assert [frame.name for frame in known.frames] == ["a.png", "b.png", "c.png"]


def tracks_of(folder: Path) -> reconstruction.Tracks:
    outputs = RobustNerfDataParserConfig(data=folder).setup().get_dataparser_outputs("train")
    return outputs.metadata[TRACKS]


def test_photos_observe_the_points_that_they_show_and_nothing_hides(tiny_scene):
    observed = copy.deepcopy(tracks_of(tiny_scene.folder)).read([0, 3])
    shown = tiny_scene.points.is_seen[: tiny_scene.spec.num_views] & ~tiny_scene.is_occluded()
    for photo, track in zip((0, 3), observed, strict=True):
        np.testing.assert_array_equal(np.sort(track), np.flatnonzero(shown[photo]))


def test_points_that_are_left_out_are_not_observed(tiny_scene):
    tracks = tracks_of(tiny_scene.folder)
    keep = np.arange(len(tracks.point_ids)) % 2 == 0

    def without(which: np.ndarray) -> Tracks:
        return replace(tracks, point_ids=tracks.point_ids[which])

    (all_of_them,), (rest,) = tracks.read([1]), without(keep).read([1])
    np.testing.assert_array_equal(2 * rest, all_of_them[keep[all_of_them]])
    (none,) = without(keep & False).read([1])
    assert none.shape == (0,)


def test_a_photo_may_observe_nothing_and_a_reconstruction_may_be_gone(tiny_copy, tmp_path: Path):
    tracks = tracks_of(tiny_copy)

    def delete(model: pycolmap.Reconstruction) -> None:
        for index in range(model.image(tracks.image_ids[2]).num_points2D()):
            model.delete_observation(tracks.image_ids[2], index)

    binary_with(tiny_copy, delete)
    assert [len(observed) > 0 for observed in tracks.read([2, 0])] == [False, True]
    with pytest.raises(CaptureError, match="gone"):
        replace(tracks, folder=tmp_path / "gone").read([0])


def test_a_text_model_keeps_spaces_in_names_and_needs_two_lines_for_each_photo(capture):
    data = capture(["map plan (1).png", "map plan (2).png"])
    names = [frame.name for frame in read_reconstruction(data, SPARSE).frames]
    assert names == ["map plan (1).png", "map plan (2).png"]
    without_observations(data / "sparse" / "0", "")
    with pytest.raises(CaptureError, match="needs two lines for each photo"):
        read_reconstruction(data, SPARSE)


def test_a_model_without_observations_has_no_tracks(capture):
    data = capture()
    without_observations(data / "sparse" / "0", "\n")
    outputs = DeSplatColmapDataParserConfig(data=data).setup().get_dataparser_outputs("train")
    assert TRACKS not in outputs.metadata


def without_observations(model: Path, in_their_place: str) -> None:
    photos = (model / "images.txt").read_text().splitlines()[::2]
    (model / "images.txt").write_text("".join(f"{line}\n{in_their_place}" for line in photos))
    points = (model / "points3D.txt").read_text().splitlines()
    (model / "points3D.txt").write_text("\n".join(" ".join(p.split()[:8]) for p in points) + "\n")
