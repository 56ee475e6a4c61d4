"""NeRF-W's split files: found by their columns, read as they are, and refused when they lie."""

from pathlib import Path

import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.split_file import draw_split, find_split_file, read_rows, read_split_file
from desplat_ns.data.splits import listed_photos

ROWS = ("a.jpg\t1.0\ttest\tx", "b.jpg\t2.0\ttrain\tx", "c.jpg\t3.0\ttrain\tx")
NAMES = ["a.jpg", "b.jpg", "c.jpg"]
SPLIT = [1, 2], [0]
HEADER = "filename\tid\tsplit\tdataset"


def table(path: Path, rows=ROWS, header: str = HEADER, encoding: str = "utf8") -> Path:
    path.write_text("\n".join([header, *rows]) + "\n", encoding=encoding)
    return path


def split_of(path: Path, names: list[str]) -> tuple[list[int], list[int]]:
    """Indices of the photos that train and of those for testing."""
    lists = read_split_file(path)
    train, test = (listed_photos(names, lists[split], path) for split in ("train", "test"))
    return train, test


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "scene.tsv"


# --- reading ------------------------------------------------------------------------------------


def test_columns_may_stand_in_any_order_beside_others(file: Path):
    rows = ("1\ttest\ta.jpg", "2\ttrain\tb.jpg", "3\ttrain\tc.jpg")
    assert split_of(table(file, rows, header="id\tsplit\tfilename"), NAMES) == SPLIT
    rows = tuple(f"note\t{row}" for row in ROWS)
    assert split_of(table(file, rows, "note\t" + HEADER), NAMES) == SPLIT


def test_rows_without_id_or_name_do_not_count(file: Path):
    gone = ["d.jpg\t\ttrain\tx", "d.jpg\tNaN\ttest\tx", "\t7.0\ttrain\tx"]
    assert split_of(table(file, (*ROWS, *gone)), NAMES) == SPLIT


def test_marks_and_line_ends_of_other_editors_are_read(file: Path):
    table(file, encoding="utf-8-sig")
    file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n") + b"\r\n")
    assert split_of(file, NAMES) == SPLIT


def test_paths_are_kept_and_blanks_around_values_are_not(file: Path):
    rows = (" ./x/a.jpg \t1\tTest\tx", "x/b.jpg\t2\t train\tx", "c.jpg\t3\ttrain\tx")
    names = ["a.jpg", "x/a.jpg", "x/b.jpg", "b.jpg", "c.jpg"]
    assert split_of(table(file, rows), names) == ([2, 4], [1])


@pytest.mark.parametrize(
    ("rows", "named"),
    [
        ((*ROWS, "d.jpg\t4\tval\tx"), r"scene\.tsv .*d\.jpg .*'val'"),
        ((*ROWS, "d.jpg\t4"), r"scene\.tsv .*d\.jpg"),
        ((*ROWS, '"d.jpg\t4\ttrain\tx'), r"scene\.tsv"),
    ],
    ids=["val", "short row", "quote"],
)
def test_tables_that_cannot_be_meant_are_errors(file: Path, rows, named: str):
    with pytest.raises(CaptureError, match=named):
        split_of(table(file, rows), NAMES)


@pytest.mark.parametrize("header", ["name\tid\tset", HEADER.replace("\t", ",")])
def test_other_columns_are_refused(file: Path, header: str):
    with pytest.raises(CaptureError, match="filename"):
        read_rows(table(file, header=header))


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_a_file_that_is_not_utf8_or_not_there_says_so(file: Path, encoding: str):
    table(file, ("café.jpg\t1\ttrain\tx",), encoding=encoding)
    with pytest.raises(CaptureError, match="UTF-8"):
        read_rows(file)
    file.unlink()
    with pytest.raises(CaptureError, match="--split-file"):
        split_of(file, NAMES)


# --- finding ------------------------------------------------------------------------------------


def test_the_file_that_has_the_columns_is_found_whatever_its_name(tmp_path: Path):
    dense = tmp_path / "dense"
    dense.mkdir()
    table(tmp_path / "notes.tsv", ("1\t2",), header="time\tplace")
    (tmp_path / "binary.tsv").write_bytes(b"\xff\xfe\x00")
    expected = table(dense / "whatever.tsv")
    assert find_split_file([tmp_path, dense]) == expected
    expected.rename(dense / "nerfw_split.csv")  # the name that nerfbaselines gives it
    assert find_split_file([tmp_path, dense]) == dense / "nerfw_split.csv"
    (dense / "link.tsv").symlink_to(dense / "nerfw_split.csv")  # the same file
    assert find_split_file([dense]) is not None
    (tmp_path / "empty").mkdir()
    assert find_split_file([tmp_path / "empty", tmp_path / "none"]) is None


def test_none_or_several_that_fit_are_an_error_and_no_silent_draw(tmp_path: Path):
    table(tmp_path / "one.tsv", header="time\tplace")
    with pytest.raises(CaptureError, match=r"one\.tsv"):
        find_split_file([tmp_path])
    table(tmp_path / "one.tsv")
    table(tmp_path / "two.tsv")
    with pytest.raises(CaptureError, match=r"one\.tsv, .*two\.tsv.*--split-file"):
        find_split_file([tmp_path])


# --- matching -----------------------------------------------------------------------------------


def test_photos_are_found_by_path_and_by_an_unambiguous_file_name(file: Path):
    rows = ("a.jpg\t1\ttest\tx", "x/b.jpg\t2\ttrain\tx", "c.jpg\t3\ttrain\tx")
    names = ["y/c.jpg", "x/b.jpg", "y/b.jpg", "a.jpg", "x/a.jpg", "unlisted.jpg"]
    assert split_of(table(file, rows), names) == ([0, 1], [3])


@pytest.mark.parametrize(
    "names",
    [["a.jpg", "c.jpg"], ["a.jpg", "x/b.jpg", "y/b.jpg", "c.jpg"]],
    ids=["absent", "ambiguous"],
)
def test_photos_that_the_reconstruction_lacks_are_left_out_and_named(file: Path, names, capsys):
    assert split_of(table(file), names) == ([len(names) - 1], [0])
    assert "1 of 2 photos" in (said := capsys.readouterr().out) and "b.jpg" in said


# --- drawing ------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 40])
def test_a_drawn_split_covers_all_and_leaves_neither_side_empty(n: int):
    names = [f"{i}.jpg" for i in range(n)]
    split = draw_split(names)
    assert sorted([*split["train"], *split["test"]]) == sorted(names)
    assert len(split["test"]) == max(1, n // 10)
    assert draw_split(names[::-1]) == split
