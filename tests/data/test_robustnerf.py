"""`robustnerf-data`: names split the photos, and a mix takes each viewpoint once; true masks ride
along and never mask training."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.data.robustnerf import (
    RobustNerfDataParserConfig,
    kind_of,
    names_by_ratio,
    viewpoint_of,
)

NAMES = [f"{kind}_{i:04d}.jpg" for kind in ("clean", "clutter") for i in range(10)]
NAMES += ["extra_0001.jpg", "extra_0002.jpg"]


def names(outputs) -> list[str]:
    return [path.name for path in outputs.image_filenames]


@pytest.mark.parametrize(
    ("name", "kind", "viewpoint"),
    [
        ("clean_0001.jpg", "clean", "0001"),
        ("clutter_0001.JPG", "clutter", "0001"),
        ("0clean012.png", "clean", "012"),
        ("2clutter012.png", "clutter", "012"),
        ("1extra003.png", "extra", "003"),
        ("0007_clean.png", "clean", "0007"),
        ("clean/clutter_5.png", "clutter", "5"),
        ("extra/clean_5.png", "clean", "5"),
        ("IMG_12.png", "clutter", "img_12"),
    ],
)
def test_the_file_name_says_what_a_photo_shows(name: str, kind: str, viewpoint: str):
    assert (kind_of(name), viewpoint_of(name)) == (kind, viewpoint)


@given(low=st.floats(0, 1), high=st.floats(0, 1))
def test_a_mix_takes_each_viewpoint_once_at_the_ratio(low: float, high: float):
    """A larger ratio keeps the cluttered photos of a smaller one."""
    cluttered = []
    for ratio in sorted((low, high)):
        picked = names_by_ratio(NAMES, ratio)
        assert sorted(map(viewpoint_of, picked)) == [f"{i:04d}" for i in range(10)]
        cluttered.append({name for name in picked if kind_of(name) == "clutter"})
        assert len(cluttered[-1]) == round(10 * ratio)
    assert cluttered[0] <= cluttered[1]


def test_photos_without_a_twin_follow_the_ratio_too():
    singles = ["clean_1", "clean_2", "clean_3", "clean_4", "clutter_5", "clutter_6"]
    assert sorted(names_by_ratio(singles, 0.0)) == singles[:4]
    assert sorted(names_by_ratio(singles, 1.0)) == singles[4:]
    half = map(kind_of, names_by_ratio(singles, 0.5))
    assert sorted(half) == ["clean", "clean", "clutter"]


@pytest.mark.parametrize("ratio", [-0.1, 1.5, float("nan")])
def test_a_ratio_outside_its_range_is_an_error(ratio: float):
    with pytest.raises(ConfigError, match="--train-split-clean-clutter-ratio"):
        RobustNerfDataParserConfig(train_split_clean_clutter_ratio=ratio).setup()


@pytest.fixture
def twins(capture) -> Path:
    names = [f"{kind}_{i}.png" for kind in ("clean", "clutter") for i in (1, 2)]
    return capture([*names, "extra_1.png"])


def test_clutter_trains_unless_clean_is_asked_for_and_extras_evaluate(twins: Path):
    (twins / "images" / "clean_1.png").unlink()  # photos that no split uses may be absent
    parser = RobustNerfDataParserConfig(data=twins).setup()
    assert names(parser.get_dataparser_outputs("train")) == ["clutter_1.png", "clutter_2.png"]
    for split in ("val", "test"):
        assert names(parser.get_dataparser_outputs(split)) == ["extra_1.png"]
    clean = RobustNerfDataParserConfig(data=twins, train_split_clean_clutter_ratio=0.0).setup()
    with pytest.raises(CaptureError, match=r"clean_1\.png"):
        clean.get_dataparser_outputs("train")


def test_gt_masks_are_listed_beside_the_photos_but_never_mask_training(twins: Path):
    (twins / "masks").mkdir()
    Image.new("L", (8, 6)).save(twins / "masks" / "clutter_2.png")
    parser = RobustNerfDataParserConfig(data=twins).setup()
    outputs = parser.get_dataparser_outputs("train")
    expected = [None, twins / "masks" / "clutter_2.png"]
    assert outputs.metadata["distractor_mask_filenames"] == expected
    assert outputs.mask_filenames is None
    assert "distractor_mask_filenames" not in parser.get_dataparser_outputs("test").metadata


@pytest.mark.parametrize(
    ("photos", "split"),
    [(["clean_1.png", "clutter_1.png"], "val"), (["clean_1.png", "extra_1.png"], "train")],
)
def test_no_photo_for_a_split_is_an_error_that_says_what_was_found(capture, photos, split: str):
    parser = RobustNerfDataParserConfig(data=capture(photos)).setup()
    with pytest.raises(CaptureError, match=photos[0]):
        parser.get_dataparser_outputs(split)
