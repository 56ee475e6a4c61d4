"""`robustnerf-data`: names split the photos; true masks ride along and never mask training."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from desplat_ns.data.robustnerf import RobustNerfDataParserConfig, robustnerf_dataparser
from desplat_ns.errors import CaptureError, ConfigError


def names(outputs) -> list[str]:
    return [path.name for path in outputs.image_filenames]


@pytest.fixture
def twins(capture) -> Path:
    return capture(
        [f"{kind}_{i}.png" for kind in ("clean", "clutter") for i in (1, 2)] + ["extra_1.png"]
    )


def test_by_default_clutter_trains_and_extras_evaluate(twins: Path):
    parser = RobustNerfDataParserConfig(data=twins).setup()
    assert names(parser.get_dataparser_outputs("train")) == ["clutter_1.png", "clutter_2.png"]
    for split in ("val", "test"):
        assert names(parser.get_dataparser_outputs(split)) == ["extra_1.png"]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"train_split_clean_clutter_ratio": 0.0}, ["clean_1.png", "clean_2.png"]),
        (
            {"train_split_mode": "number", "train_split_num_clean": 2},
            ["clean_1.png", "clean_2.png"],
        ),
        (
            {"train_split_mode": "filename", "train_split_file": Path("mine.txt")},
            ["clean_2.png", "clutter_1.png"],
        ),
    ],
    ids=["ratio", "number", "filename"],
)
def test_every_mode_chooses_its_photos(twins: Path, options: dict, expected: list[str]):
    (twins / "mine.txt").write_text("clutter_1.png\nclean_2.png\n")
    parser = RobustNerfDataParserConfig(data=twins, **options).setup()
    assert names(parser.get_dataparser_outputs("train")) == expected


def test_gt_masks_are_listed_beside_the_photos_but_never_mask_training(twins: Path):
    (twins / "masks").mkdir()
    Image.new("L", (8, 6)).save(twins / "masks" / "clutter_2.png")
    parser = RobustNerfDataParserConfig(data=twins).setup()
    outputs = parser.get_dataparser_outputs("train")
    expected = [None, twins / "masks" / "clutter_2.png"]
    assert outputs.metadata["distractor_mask_filenames"] == expected
    assert outputs.mask_filenames is None
    assert "distractor_mask_filenames" not in parser.get_dataparser_outputs("test").metadata


def test_photos_that_no_split_uses_may_be_absent(twins: Path):
    (twins / "images" / "clean_1.png").unlink()
    parser = RobustNerfDataParserConfig(data=twins).setup()
    assert len(parser.get_dataparser_outputs("train").image_filenames) == 2


def test_no_photo_to_evaluate_on_is_an_error_that_says_what_was_found(capture):
    parser = RobustNerfDataParserConfig(data=capture(["clean_1.png", "clutter_1.png"])).setup()
    with pytest.raises(CaptureError, match=r"evaluate on: .* 1 clutter, 0 extra .*`extra`"):
        parser.get_dataparser_outputs("val")


def test_no_photo_to_train_on_is_an_error_that_says_what_was_found(capture):
    data = capture(["clean_1.png", "clean_2.png", "extra_1.png"])
    with pytest.raises(CaptureError, match=r"0 clutter, 1 extra .*ratio 0 takes the clean"):
        RobustNerfDataParserConfig(data=data).setup().get_dataparser_outputs("train")


def test_filename_mode_needs_a_file(twins: Path):
    parser = RobustNerfDataParserConfig(data=twins, train_split_mode="filename").setup()
    with pytest.raises(ConfigError, match="--train-split-file"):
        parser.get_dataparser_outputs("train")


def test_the_registered_dataparser_is_this_one():
    assert isinstance(robustnerf_dataparser.config, RobustNerfDataParserConfig)


@pytest.mark.real_data
def test_fox_cluttered_has_forty_pairs_and_ten_extras(data_folder):
    data = data_folder("fox_cluttered")
    parser = RobustNerfDataParserConfig(data=data, downscale_factor=2).setup()
    train, test = (parser.get_dataparser_outputs(split) for split in ("train", "test"))
    assert (len(train.image_filenames), len(test.image_filenames)) == (40, 10)
    assert all(path is not None for path in train.metadata["distractor_mask_filenames"])
    assert {(c.width.item(), c.height.item()) for c in train.cameras} == {(135, 240)}
