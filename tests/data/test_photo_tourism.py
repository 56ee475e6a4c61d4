"""`photo-tourism-data`: the folders as they are downloaded, photos of any size, NeRF-W's split: its
files are found by their columns, read as they are, and refused when they lie."""

from pathlib import Path

import pytest
import torch

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.dataset import CaptureDataset
from desplat_ns.data.photo_tourism import (
    PhotoTourismDataParser,
    PhotoTourismDataParserConfig,
    draw_split,
    find_split_file,
    read_rows,
    read_split_file,
)
from desplat_ns.data.splits import listed_photos
from tests.helpers.files import write_split

ROWS = ("a.jpg\t1.0\ttest\tx", "b.jpg\t2.0\ttrain\tx", "c.jpg\t3.0\ttrain\tx")
NAMES = ["a.jpg", "b.jpg", "c.jpg"]
SPLIT = [1, 2], [0]
HEADER = "filename\tid\tsplit\tdataset"


def parser_of(data: Path, **options) -> PhotoTourismDataParser:
    return PhotoTourismDataParserConfig(data=data, **options).setup()


def names(parser: PhotoTourismDataParser, split: str) -> list[str]:
    return [path.name for path in parser.get_dataparser_outputs(split).image_filenames]


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


def test_the_split_file_decides_and_test_stands_in_for_val(scene):
    parser = parser_of(scene())
    assert names(parser, "train") == ["a.jpg", "b.jpg"]
    assert names(parser, "val") == names(parser, "test") == ["c.jpg"]
    camera = parser.get_dataparser_outputs("test").cameras[0]
    assert (camera.width.item(), camera.height.item()) == (12, 4)  # that of the photo


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


def test_the_file_that_has_the_columns_is_found_whatever_its_name(tmp_path: Path):
    dense = tmp_path / "dense"
    dense.mkdir()
    table(tmp_path / "notes.tsv", ("1\t2",), header="time\tplace")
    (tmp_path / "binary.tsv").write_bytes(b"\xff\xfe\x00")
    expected = table(dense / "whatever.tsv")
    assert find_split_file(tmp_path) == expected
    expected.rename(dense / "nerfw_split.csv")  # the name that nerfbaselines gives it
    assert find_split_file(tmp_path) == dense / "nerfw_split.csv"
    (dense / "link.tsv").symlink_to(dense / "nerfw_split.csv")  # the same file
    assert find_split_file(dense) is not None
    (tmp_path / "empty").mkdir()
    assert find_split_file(tmp_path / "empty") is None


def test_none_or_several_that_fit_are_an_error_and_no_silent_draw(tmp_path: Path):
    table(tmp_path / "one.tsv", header="time\tplace")
    with pytest.raises(CaptureError, match=r"one\.tsv"):
        find_split_file(tmp_path)
    table(tmp_path / "one.tsv")
    table(tmp_path / "two.tsv")
    with pytest.raises(CaptureError, match=r"one\.tsv, .*two\.tsv.*--split-file"):
        find_split_file(tmp_path)


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


@pytest.mark.parametrize("n", [2, 3, 40])
def test_a_drawn_split_covers_all_and_leaves_neither_side_empty(n: int):
    names = [f"{i}.jpg" for i in range(n)]
    split = draw_split(names)
    assert sorted([*split["train"], *split["test"]]) == sorted(names)
    assert len(split["test"]) == max(1, n // 10)
    assert draw_split(names[::-1]) == split
