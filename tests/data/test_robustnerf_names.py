"""File names decide; a mix takes each viewpoint once."""

from __future__ import annotations

import codecs
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.data.robustnerf_names import (
    describe,
    evaluation_views,
    kind_of,
    viewpoint_of,
    views_by_file,
    views_by_number,
    views_by_ratio,
)
from desplat_ns.errors import CaptureError, ConfigError

TWINS = [f"{kind}_{i:04d}.jpg" for kind in ("clean", "clutter") for i in range(10)]
NAMES = [*TWINS, "extra_0001.jpg", "extra_0002.jpg"]


def kinds(picked: list[int], names: list[str] = NAMES) -> list[str]:
    return [kind_of(names[i]) for i in picked]


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


def test_extras_and_nothing_else_are_held_out():
    assert evaluation_views(NAMES) == [20, 21]
    assert describe(NAMES) == "10 clean, 10 clutter, 2 extra"


def test_the_ends_of_the_ratio_are_all_clean_and_all_clutter():
    assert views_by_ratio(NAMES, 0.0, seed=3) == list(range(10))
    assert views_by_ratio(NAMES, 1.0, seed=3) == list(range(10, 20))


@given(ratio=st.floats(0, 1), seed=st.integers(0, 99))
def test_a_mix_takes_each_viewpoint_once_at_the_ratio(ratio: float, seed: int):
    picked = views_by_ratio(NAMES, ratio, seed)
    assert sorted(viewpoint_of(NAMES[i]) for i in picked) == [f"{i:04d}" for i in range(10)]
    assert kinds(picked).count("clutter") == round(10 * ratio)
    assert picked == sorted(picked)


@given(low=st.floats(0, 1), high=st.floats(0, 1), seed=st.integers(0, 9))
def test_a_larger_ratio_keeps_the_cluttered_photos_of_a_smaller_one(low, high, seed):
    few, many = (
        {i for i in views_by_ratio(NAMES, ratio, seed) if kind_of(NAMES[i]) == "clutter"}
        for ratio in sorted((low, high))
    )
    assert few <= many


def test_the_seed_decides_which_viewpoints_are_cluttered():
    half = [tuple(views_by_ratio(NAMES, 0.5, seed)) for seed in range(5)]
    assert half == [tuple(views_by_ratio(NAMES, 0.5, seed)) for seed in range(5)]
    assert len(set(half)) > 1


def test_photos_without_a_twin_follow_the_ratio_too():
    names = ["clean_1", "clean_2", "clean_3", "clean_4", "clutter_5", "clutter_6"]
    assert views_by_ratio(names, 0.0, seed=0) == [0, 1, 2, 3]
    assert views_by_ratio(names, 1.0, seed=0) == [4, 5]
    assert sorted(kinds(views_by_ratio(names, 0.5, 0), names)) == ["clean", "clean", "clutter"]


@pytest.mark.parametrize("ratio", [-0.1, 1.5, float("nan")])
def test_a_ratio_outside_its_range_is_an_error(ratio: float):
    with pytest.raises(ConfigError, match=r"--train-split-clean-clutter-ratio is .*between 0"):
        views_by_ratio(NAMES, ratio, seed=0)


def test_numbers_are_met_and_twins_avoided():
    picked = views_by_number(NAMES, num_clean=4, num_clutter=6, seed=1)
    assert kinds(picked) == ["clean"] * 4 + ["clutter"] * 6
    assert len({viewpoint_of(NAMES[i]) for i in picked}) == 10
    assert len(views_by_number(NAMES, 10, 10, seed=1)) == 20


def test_more_photos_than_there_are_is_an_error():
    with pytest.raises(ConfigError, match=r"--train-split-num-clean is 11; .*has 10 clean"):
        views_by_number(NAMES, 11, 0, seed=0)
    with pytest.raises(ConfigError, match="--train-split-num-clutter is -1"):
        views_by_number(NAMES, 0, -1, seed=0)


def test_a_file_lists_photos_by_path_or_by_name(tmp_path: Path):
    listing = tmp_path / "train.txt"
    listing.write_text("# mine\n\nclutter_0003.jpg\nfolder/clean_7.png\nclean_8.png\n")
    names = [*NAMES, "folder/clean_7.png", "folder/clean_8.png"]
    assert views_by_file(names, listing) == [13, 22, 23]


def test_a_file_that_begins_with_a_byte_order_mark_is_read(tmp_path: Path):
    listing = tmp_path / "train.txt"
    listing.write_bytes(codecs.BOM_UTF8 + b"clutter_0003.jpg\r\n")
    assert views_by_file(NAMES, listing) == [13]


def test_a_file_in_another_encoding_is_named(tmp_path: Path):
    (tmp_path / "train.txt").write_bytes("clutter_ü.jpg".encode("latin-1"))
    with pytest.raises(CaptureError, match=r"train\.txt cannot be read as UTF-8"):
        views_by_file(NAMES, tmp_path / "train.txt")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("nothing.jpg", "1 of 2 lines .*: nothing.jpg"),
        ("same.jpg", "or several: same.jpg"),
        ("extra_0001.jpg", "held out for evaluation: extra_0001.jpg"),
    ],
)
def test_lines_that_do_not_fit_are_listed(tmp_path: Path, line: str, message: str):
    (tmp_path / "train.txt").write_text(f"clean_0001.jpg\n{line}\n")
    with pytest.raises(CaptureError, match=message):
        views_by_file([*NAMES, "a/same.jpg", "b/same.jpg"], tmp_path / "train.txt")


def test_a_missing_list_is_named(tmp_path: Path):
    with pytest.raises(CaptureError, match=r"train\.txt does not exist.*--train-split-file"):
        views_by_file(NAMES, tmp_path / "train.txt")
