"""Photos are told from other files by their names; folders of copies by their numbers."""

from pathlib import Path

from desplat_ns.data.photo_files import (
    begin_folder,
    downscale_factors,
    exposed_together,
    photo_names,
    photos_near,
)
from tests.helpers.files import touch


def test_photos_are_listed_below_their_folder_and_those_near_not_far_down(tmp_path: Path):
    touch(tmp_path, "b.JPG", "a/c.png", "a/b/d.tif", "notes.txt", "._b.jpg")
    assert photo_names(tmp_path) == ["a/b/d.tif", "a/c.png", "b.JPG"]
    assert photos_near(tmp_path) == ["a/c.png", "b.JPG"]
    assert photo_names(tmp_path / "absent") == []


def test_photos_behind_links_to_folders_are_listed_once(tmp_path: Path):
    touch(tmp_path, "real/b.jpg", "photos/a.jpg")
    (tmp_path / "photos" / "day2").symlink_to(tmp_path / "real")
    (tmp_path / "real" / "back").symlink_to(tmp_path / "photos")
    assert photo_names(tmp_path / "photos") == ["a.jpg", "day2/b.jpg"]


def test_factors_are_those_of_folders_beside_the_photos(tmp_path: Path):
    for name in ("images", "images_16", "images_2", "images_0", "images_4x", "masks_3"):
        (tmp_path / name).mkdir()
    touch(tmp_path, "images_5")
    assert downscale_factors(tmp_path / "images") == [2, 16]
    assert downscale_factors(tmp_path / "absent" / "images") == []


def test_photos_of_a_capture_and_their_reduced_copies_are_exposed_together(tmp_path: Path):
    touch(tmp_path, "images/day/a.exr", "images_4/day/a.exr", "alone_2/a.exr", "other/a.exr")
    for name in ("images", "alone_2"):
        begin_folder(tmp_path / name, [])
    of = {path.parent: exposed_together(path) for path in tmp_path.rglob("*.exr")}
    assert of[tmp_path / "images/day"] == of[tmp_path / "images_4/day"] == tmp_path / "images"
    assert of[tmp_path / "alone_2"] == tmp_path / "alone_2"
    assert of[tmp_path / "other"] == tmp_path / "other"
