"""`photo-tourism-data`: the folders as they are downloaded, photos of any size, NeRF-W's split."""

from pathlib import Path

import pytest
import torch

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.dataset import CaptureDataset
from desplat_ns.data.photo_tourism import PhotoTourismDataParser, PhotoTourismDataParserConfig
from tests.helpers.files import write_split


def parser_of(data: Path, **options) -> PhotoTourismDataParser:
    return PhotoTourismDataParserConfig(data=data, **options).setup()


def names(parser: PhotoTourismDataParser, split: str) -> list[str]:
    return [path.name for path in parser.get_dataparser_outputs(split).image_filenames]


# --- layouts ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("images", "sparse"),
    [("dense/images", "dense/sparse"), ("dense/images", "dense/sparse/0"), ("images", "sparse")],
)
def test_the_usual_layouts_are_found(scene, images: str, sparse: str):
    data = scene(images=images, sparse=sparse)
    paths = parser_of(data).get_dataparser_outputs("train").image_filenames
    assert paths == [data / images / "a.jpg", data / images / "b.jpg"]


def test_undistorted_photos_come_before_the_originals(scene):
    data = scene()
    scene(images="images", sparse="sparse/0")
    assert parser_of(data).config.images_path == Path("dense/images")


def test_photos_of_one_root_never_go_with_the_reconstruction_of_the_other(scene):
    data = scene(images="images")
    with pytest.raises(CaptureError, match="--images-path"):
        parser_of(data).get_dataparser_outputs("train")
    named = parser_of(data, images_path=Path("images"))
    assert names(named, "train") == ["a.jpg", "b.jpg"]


# --- split --------------------------------------------------------------------------------------


def test_the_split_file_decides_and_test_stands_in_for_val(scene):
    parser = parser_of(scene())
    assert names(parser, "train") == ["a.jpg", "b.jpg"]
    assert names(parser, "val") == names(parser, "test") == ["c.jpg"]
    camera = parser.get_dataparser_outputs("test").cameras[0]
    assert (camera.width.item(), camera.height.item()) == (12, 4)  # that of the photo


@pytest.mark.parametrize("folder", ["dense", "."])
def test_the_split_file_is_found_in_dense_and_above_it(scene, folder: str):
    data = scene()
    (data / "scene.tsv").rename(data / folder / "scene.tsv")
    # d.jpg would be used by a split that is drawn.
    assert names(parser_of(data), "train") == ["a.jpg", "b.jpg"]
    assert names(parser_of(data / "dense"), "train") == ["a.jpg", "b.jpg"]


def test_of_several_split_files_one_can_be_named(scene):
    data = scene()
    write_split(data / "mine.txt", {"a.jpg": "test", "b.jpg": "train", "d.jpg": "train"})
    assert names(parser_of(data, split_file=Path("mine.txt")), "test") == ["a.jpg"]


def test_without_a_split_file_photos_are_drawn_and_named(scene, capsys):
    data = scene(None)
    parser = parser_of(data)
    train, test = names(parser, "train"), names(parser, "test")
    assert (len(train), len(test)) == (3, 1)
    assert sorted(train + test) == ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]
    assert capsys.readouterr().out.count(test[0]) == 1


# --- photos -------------------------------------------------------------------------------------


def test_by_default_each_photo_is_halved_until_it_is_small_enough(scene, photo_writer, capsys):
    data = scene()
    file = data / "dense" / "sparse" / "cameras.txt"
    file.write_text(
        file.read_text().replace("1 PINHOLE 8 6 10 11 4 3", "1 PINHOLE 3300 3 10 11 1650 1.5")
    )
    photo_writer(data / "dense" / "images" / "a.jpg", 3300, 3)
    outputs = parser_of(data).get_dataparser_outputs("train")
    sizes = torch.cat([outputs.cameras.width, outputs.cameras.height], dim=1)
    assert sizes.tolist() == [[825, 1], [6, 8]]  # 3300 / 4, 3 / 4 and never below one pixel
    assert outputs.cameras.fx.flatten().tolist() == [2.5, 10.0]
    assert "1 of 2 photos" in capsys.readouterr().out
    dataset = CaptureDataset(outputs)
    assert dataset.get_data(0)["image"].shape == (1, 825, 3)


# --- the rest is the colmap parser's ------------------------------------------------------------


@pytest.mark.real_data
def test_sacre_coeur_has_eight_photos_to_train_on_and_two_for_testing(data_folder):
    data = data_folder("sacre_coeur")
    parser = parser_of(data)
    outputs = parser.get_dataparser_outputs("train")
    assert len(outputs.image_filenames) == 8
    assert names(parser, "test") == ["10265353_3838484249.jpg", "71295362_4051449754.jpg"]
    sizes = torch.cat([outputs.cameras.width, outputs.cameras.height], dim=1)
    assert len(sizes.unique(dim=0)) == 8
    assert len(outputs.metadata["points3D_xyz"]) > 4000
    CaptureDataset(outputs).check_photos()
