"""NeRF-W's split files: found by their columns, read as they are, and refused when they lie."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.photo_tourism.split_file import (
    PhotoSplit,
    draw_split,
    find_split_file,
    match_split,
    read_rows,
    read_split_file,
)

ROWS = ("a.jpg\t1.0\ttest\tx", "b.jpg\t2.0\ttrain\tx", "c.jpg\t3.0\ttrain\tx")
HEADER = "filename\tid\tsplit\tdataset"


def table(path: Path, rows=ROWS, header: str = HEADER, encoding: str = "utf8") -> Path:
    path.write_text("\n".join([header, *rows]) + "\n", encoding=encoding)
    return path


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "scene.tsv"


# --- reading ------------------------------------------------------------------------------------


def test_rows_train_or_test_in_the_files_order(file: Path):
    listed = read_split_file(table(file))
    assert (listed.train, listed.test) == (["b.jpg", "c.jpg"], ["a.jpg"])
    assert listed.num_skipped == 0


def test_columns_may_stand_in_any_order_beside_others(file: Path):
    rows = ("1\ttest\ta.jpg", "2\ttrain\tb.jpg", "3\ttrain\tc.jpg")
    listed = read_split_file(table(file, rows, header="id\tsplit\tfilename"))
    assert (listed.train, listed.test) == (["b.jpg", "c.jpg"], ["a.jpg"])
    rows = tuple(f"note\t{row}" for row in ROWS)
    assert read_split_file(table(file, rows, "note\t" + HEADER)).test == ["a.jpg"]


@pytest.mark.parametrize("gone", ["d.jpg\t\ttrain\tx", "d.jpg\tNaN\ttest\tx", "\t7.0\ttrain\tx"])
def test_rows_without_id_or_name_do_not_count(file: Path, gone: str):
    listed = read_split_file(table(file, (*ROWS, gone)))
    assert (len(listed.train), len(listed.test), listed.num_skipped) == (2, 1, 1)


def test_marks_and_line_ends_of_other_editors_are_read(file: Path):
    table(file, encoding="utf-8-sig")
    file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n") + b"\r\n")
    assert read_split_file(file).test == ["a.jpg"]


def test_paths_are_kept_and_blanks_around_values_are_not(file: Path):
    rows = (" ./x/a.jpg \t1\tTest\tx", "x/b.jpg\t2\t train\tx", "c.jpg\t3\ttrain\tx")
    listed = read_split_file(table(file, rows))
    assert (listed.train, listed.test) == (["x/b.jpg", "c.jpg"], ["x/a.jpg"])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (ROWS[1:], r"scene\.tsv lists 2 photos to train on and 0 to test on"),
        (ROWS[:2], r"lists 1 photos to train on and 1 to test on .*at least two"),
        ((), r"lists 0 photos"),
        ((*ROWS, "d.jpg\t4\tval\tx"), r"Line 5 of .*scene\.tsv gives d\.jpg the split 'val'"),
        ((*ROWS, "d.jpg\t4"), r"Line 5 .* the split ''"),
        ((*ROWS, '"d.jpg\t4\ttrain\tx'), r"scene\.tsv cannot be read: unexpected end of data"),
    ],
    ids=["no test", "one train", "nothing", "val", "short row", "quote"],
)
def test_tables_that_cannot_be_meant_are_errors(file: Path, rows, message: str):
    with pytest.raises(CaptureError, match=message):
        read_split_file(table(file, rows))


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("name\tid\tset", r"scene\.tsv has no column filename, split\. Found: name, id, set; need"),
        (HEADER.replace("\t", ","), r"Found: filename,id,split,dataset; .*with tabs between"),
        ("", r"Found: (nothing|a\.jpg)"),
    ],
    ids=["others", "commas", "none"],
)
def test_other_columns_are_named_with_those_needed(file: Path, header: str, message: str):
    with pytest.raises(CaptureError, match=message):
        read_rows(table(file, header=header))


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_a_file_that_is_not_utf8_says_so(file: Path, encoding: str):
    table(file, ("café.jpg\t1\ttrain\tx",), encoding=encoding)
    with pytest.raises(CaptureError, match=r"scene\.tsv is not UTF-8 text .*Save it as UTF-8"):
        read_rows(file)


def test_an_image_is_no_table(file: Path):
    file.write_bytes(bytes(range(128)) * 20)
    with pytest.raises(CaptureError, match=r"split file .*scene\.tsv"):
        read_rows(file)


def test_a_missing_file_says_where_it_was_looked_for(file: Path):
    with pytest.raises(CaptureError, match=r"scene\.tsv does not exist.*--split-file"):
        read_split_file(file)


# --- finding ------------------------------------------------------------------------------------


def test_the_file_that_has_the_columns_is_found_whatever_its_name(tmp_path: Path):
    dense = tmp_path / "dense"
    dense.mkdir()
    table(tmp_path / "notes.tsv", ("1\t2",), header="time\tplace")
    (tmp_path / "binary.tsv").write_bytes(b"\xff\xfe\x00")
    expected = table(dense / "whatever.tsv")
    assert find_split_file([tmp_path, dense]) == expected


def test_nerfbaselines_name_is_found_too(tmp_path: Path):
    assert find_split_file([tmp_path]) is None
    expected = table(tmp_path / "nerfw_split.csv")
    assert find_split_file([tmp_path, tmp_path / "none"]) == expected


def test_one_file_in_two_folders_by_a_link_is_one(tmp_path: Path, file: Path):
    (tmp_path / "link.tsv").symlink_to(table(file))
    assert find_split_file([tmp_path]) is not None


def test_several_that_fit_are_an_error_that_names_them(tmp_path: Path):
    table(tmp_path / "one.tsv")
    table(tmp_path / "two.tsv")
    with pytest.raises(CaptureError, match=r"2 split files .*one\.tsv, .*two\.tsv.*--split-file"):
        find_split_file([tmp_path])


def test_one_that_does_not_fit_is_an_error_and_no_silent_draw(tmp_path: Path):
    table(tmp_path / "one.tsv", header="time\tplace")
    with pytest.raises(CaptureError, match=r"one\.tsv has no column filename.*--test-fraction"):
        find_split_file([tmp_path])


# --- matching -----------------------------------------------------------------------------------


def test_photos_are_found_by_path_and_by_an_unambiguous_file_name(file: Path):
    rows = ("a.jpg\t1\ttest\tx", "x/b.jpg\t2\ttrain\tx", "c.jpg\t3\ttrain\tx")
    names = ["y/c.jpg", "x/b.jpg", "y/b.jpg", "a.jpg", "x/a.jpg", "unlisted.jpg"]
    assert match_split(names, read_split_file(table(file, rows))) == PhotoSplit([0, 1], [3])


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a.jpg", "c.jpg"], r"1 of 3 photos in .*scene\.tsv are not in the .*: b\.jpg"),
        (["a.jpg", "x/b.jpg", "y/b.jpg", "c.jpg"], r"or not unambiguously: b\.jpg"),
        (["z.jpg"], r"3 of 3 photos .*: b\.jpg, c\.jpg, a\.jpg\. The reconstruction has z\.jpg"),
    ],
    ids=["absent", "ambiguous", "another scene"],
)
def test_photos_that_the_reconstruction_lacks_are_named(file: Path, names, message: str):
    with pytest.raises(CaptureError, match=message):
        match_split(names, read_split_file(table(file)))


@pytest.mark.parametrize("again", ["a.jpg\t1\ttest", "a.jpg\t1\ttrain", "x/a.jpg\t1\ttrain"])
def test_a_photo_in_two_rows_is_named(file: Path, again: str):
    listed = read_split_file(table(file, (*ROWS, again)))
    with pytest.raises(CaptureError, match=r"scene\.tsv lists 1 photos more than once: x/a\.jpg"):
        match_split(["x/a.jpg", "b.jpg", "c.jpg"], listed)


# --- drawing ------------------------------------------------------------------------------------


@given(
    n=st.integers(2, 40),
    fraction=st.floats(0.001, 0.999),
    seed=st.integers(0, 5),
    order=st.randoms(use_true_random=False),
)
def test_a_drawn_split_covers_all_and_leaves_neither_side_empty(
    n: int, fraction: float, seed: int, order: random.Random
):
    names = [f"{i}.jpg" for i in range(n)]
    split = draw_split(names, fraction, seed)
    assert sorted(split.train + split.test) == list(range(n))
    assert len(split.test) == min(max(1, round(fraction * n)), n - 1)
    mixed = order.sample(names, n)
    again = draw_split(mixed, fraction, seed)
    assert {mixed[i] for i in again.test} == {names[i] for i in split.test}
    larger = draw_split(names, min(0.999, fraction * 1.5), seed)
    assert set(split.test) <= set(larger.test)


def test_the_seed_changes_the_draw():
    names = [f"{i}.jpg" for i in range(40)]
    assert draw_split(names, 0.1, 0) == draw_split(names, 0.1, 0)
    assert draw_split(names, 0.1, 0) != draw_split(names, 0.1, 1)


@pytest.mark.parametrize("fraction", [0.0, 1.0, -0.1, 2.0, float("nan")])
def test_fractions_outside_zero_and_one_are_refused(fraction: float):
    with pytest.raises(ConfigError, match=r"--test-fraction is .* between 0 and 1"):
        draw_split(["a.jpg", "b.jpg"], fraction, 0)
