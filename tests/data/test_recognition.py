"""Every layout is recognised, the most specific first; what is no capture is told what to do."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.layouts import Recognition, recognise
from desplat_ns.data.on_the_go import OnTheGoDataParserConfig
from desplat_ns.data.photo_tourism import PhotoTourismDataParserConfig
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.data.transforms_json import TransformsDataParser
from desplat_ns.tools.studies.methods import parse
from tests.helpers.files import write_transforms

TWINS = ("clean_1.png", "clutter_1.png", "extra_1.png")


def parser_of(data: Path) -> type[DataParserConfig]:
    return type(recognise(data).config({}))


def parsers_beside(chosen: Recognition) -> list[str]:
    return [other.parser for other in chosen.others]


def write_split(data: Path, **lists: list[int]) -> Path:
    (data / "split.json").write_text(json.dumps(lists))
    return data


def write_blender(data: Path, photo_writer, **changes: object) -> Path:
    """The layout of the NeRF synthetic scenes: two photos in each split."""
    for split in ("train", "val", "test"):
        for i in range(2):
            photo_writer(data / split / f"r_{i}.png")
        pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
        frames = [{"file_path": f"./{split}/r_{i}", "transform_matrix": pose} for i in range(2)]
        document = {"camera_angle_x": 0.7, "frames": frames} | changes
        (data / f"transforms_{split}.json").write_text(json.dumps(document))
    return data


@pytest.mark.parametrize("place", ["sparse", "sparse/0", "colmap/sparse/0"])
def test_a_colmap_model_is_found_in_every_usual_place(tmp_path, model_writer, place: str):
    model_writer(tmp_path / place, ["a.png", "b.png"])
    chosen = recognise(tmp_path)
    assert chosen.words == ("colmap",)
    assert type(chosen.config({})) is DeSplatColmapDataParserConfig
    assert f"COLMAP's model in {place}. It is read by colmap." in chosen.line()


def test_transforms_json_is_read_with_points_and_without_questions(tmp_path: Path):
    for data in (write_transforms(tmp_path, []), tmp_path / "transforms.json"):
        config = recognise(data).config({})
        assert isinstance(config, NerfstudioDataParserConfig)
        assert (config._target, config.load_3D_points) == (TransformsDataParser, True)
        assert config.data == data


def test_robustnerfs_names_are_told_from_others(capture: Callable[..., Path]):
    data = capture(TWINS)
    assert parser_of(data) is RobustNerfDataParserConfig
    assert "1 clean, 1 clutter, 1 extra" in recognise(data).line()
    for name in TWINS[:2]:
        (data / "images" / name).unlink()
    assert parser_of(data) is DeSplatColmapDataParserConfig  # an `extra` alone says nothing
    (data / "images" / TWINS[0]).write_bytes(b"")
    (data / "images" / TWINS[2]).unlink()
    assert parser_of(data) is DeSplatColmapDataParserConfig  # nor does a `clean`


def test_names_are_read_from_smaller_copies_if_there_is_nothing_else(capture):
    data = capture(TWINS)
    (data / "images").rename(data / "images_8")
    (data / "images_16").mkdir()
    assert recognise(data).words == ("robustnerf-data", "--downscale-factor", "8")
    assert recognise(data).others == ()


@pytest.mark.parametrize("split", [True, False])
def test_photo_tourism_is_dense_with_or_without_a_split_file(capture, tmp_path, split: bool):
    data = tmp_path / "scene"
    shutil.move(capture(), data / "dense")
    if split:
        (data / "scene.tsv").write_text("filename\tid\tsplit\na.png\t1\ttrain\n")
    for folder in (data, data / "dense"):
        chosen = recognise(folder)
        assert type(chosen.config({})) is PhotoTourismDataParserConfig
        assert ("the split file scene.tsv" if split else "no split file") in chosen.line()
        assert chosen.others == ()


def test_a_split_file_makes_photo_tourism_of_a_colmap_capture(capture: Callable[..., Path]):
    data = capture()
    (data / "notes.tsv").write_text("what\twhen\n")
    assert parser_of(data) is DeSplatColmapDataParserConfig
    (data / "nerfw.tsv").write_text("filename\tid\tsplit\n")
    assert parser_of(data) is PhotoTourismDataParserConfig


@pytest.mark.parametrize("poses", ["colmap", "transforms"])
def test_on_the_go_is_its_split_file_over_poses(capture, tmp_path, poses: str):
    data = capture(TWINS) if poses == "colmap" else write_transforms(tmp_path, [])
    write_split(data, clutter=[0, 1], extra=[2])
    chosen = recognise(data)
    assert type(chosen.config({})) is OnTheGoDataParserConfig
    assert "split.json (2 clutter, 1 extra)" in chosen.line()
    assert chosen.others == ()
    write_split(data, train=[0, 1], test=[2])
    assert parser_of(data) is not OnTheGoDataParserConfig


def test_of_two_layouts_it_says_which_was_taken_and_what_to_type_for_the_other(capture):
    chosen = recognise(write_transforms(capture(), []))
    assert chosen.parser == "nerfstudio-data"
    assert parsers_beside(chosen) == ["colmap"] and "`colmap`" in chosen.line()
    (chosen.data / "images").joinpath("extra_1.png").write_bytes(b"")
    (chosen.data / "images").joinpath("clean_1.png").write_bytes(b"")
    assert "`nerfstudio-data --load-3D-points True`" in recognise(chosen.data).line()


def test_photos_before_and_after_undistortion_are_two_captures(capture, tmp_path: Path):
    data = capture()
    shutil.copytree(data, tmp_path / "undistorted")
    shutil.move(tmp_path / "undistorted", data / "dense")
    chosen = recognise(data)
    assert chosen.parser == "photo-tourism-data"
    assert parsers_beside(chosen) == ["colmap"]


@pytest.mark.usefixtures("tyro_may_build")
def test_the_words_that_are_given_are_understood(capture: Callable[..., Path]):
    (capture() / "images_2").mkdir()
    data = capture()
    shutil.rmtree(data / "images")
    for chosen in (recognise(data), recognise(write_transforms(data, []))):
        parsed = parse("desplat", list(chosen.words)).pipeline.datamanager.dataparser
        assert parsed.downscale_factor == chosen.config({}).downscale_factor  # pyright: ignore
        assert parsed.load_3D_points


def test_what_is_given_comes_before_what_the_layout_asks_for(tmp_path, model_writer):
    model_writer(tmp_path / "sparse", ["a.png", "b.png"])
    (tmp_path / "images_4").mkdir()
    assert recognise(tmp_path).config({}).downscale_factor == 4  # pyright: ignore
    given = recognise(tmp_path).config({"downscale_factor": 8, "eval_interval": 5})
    assert isinstance(given, DeSplatColmapDataParserConfig)
    assert (given.downscale_factor, given.eval_interval) == (8, 5)


def test_a_split_cannot_be_asked_for_where_the_layout_has_one(capture: Callable[..., Path]):
    data = capture(TWINS)
    with pytest.raises(ConfigError, match=r"`colmap --eval-mode all`.*`robustnerf-data --help`"):
        recognise(data).config({"eval_mode": "all"})
    parser: Any = DeSplatColmapDataParserConfig(data=data, eval_mode="all").setup()
    assert len(parser.get_dataparser_outputs("train").image_filenames) == len(TWINS)


def test_photos_without_poses_are_told_where_poses_come_from(tmp_path, photo_writer):
    for name in ("a.jpg", "more/b.png"):
        photo_writer(tmp_path / name)
    with pytest.raises(CaptureError, match=r"a\.jpg, more/b\.png.*desplat-process"):
        recognise(tmp_path)


@pytest.mark.parametrize("name", ["absent", "absent.json", "empty", "film.mp4", "notes"])
def test_what_is_no_capture_is_named(tmp_path: Path, name: str):
    (tmp_path / "empty").mkdir()
    (tmp_path / "film.mp4").write_bytes(b"")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "notes.txt").write_text("")
    with pytest.raises(CaptureError, match=name):
        recognise(tmp_path / name)


def test_the_folder_of_captures_and_the_photos_of_one_lead_to_it(capture: Callable[..., Path]):
    data = capture()
    for folder in (data.parent, data / "images"):
        with pytest.raises(CaptureError, match=f"by --data: {data}"):
            recognise(folder)


def test_nerf_synthetic_scenes_are_read_by_blender_data(tmp_path: Path, photo_writer):
    chosen = recognise(write_blender(tmp_path, photo_writer))
    assert chosen.words == ("blender-data",)
    outputs = chosen.config({"scale_factor": 0.5}).setup().get_dataparser_outputs("train")
    assert [path.name for path in outputs.image_filenames] == ["r_0.png", "r_1.png"]
    assert outputs.cameras.camera_to_worlds[0, 2, 3] == 2
    for option, name in (("eval_mode", "--eval-mode"), ("downscale_factor", "--downscale-factor")):
        with pytest.raises(ConfigError, match=name):
            chosen.config({option: 2})
    beside = recognise(write_transforms(tmp_path, []))
    assert beside.parser == "nerfstudio-data"
    assert parsers_beside(beside) == ["blender-data"]


@pytest.mark.parametrize(
    "changes",
    [
        {"camera_angle_x": None},
        {"frames": []},
        {"frames": [{"file_path": "train/r_0.png"}]},
        {"frames": [{"path": "x"}]},
        None,
    ],
)
def test_what_blender_data_would_misread_is_told_what_to_type(
    tmp_path: Path, photo_writer, changes: dict[str, object] | None
):
    write_blender(tmp_path, photo_writer, **changes or {})
    if changes is None:
        (tmp_path / "transforms_val.json").unlink()
    with pytest.raises(CaptureError, match="nerfstudio's fields, name one of them itself"):
        recognise(tmp_path)
