"""What hand-made numbers decide: pairs, cameras, frames, reasons."""

from pathlib import Path

from desplat_ns.tools.process.photos import Photo, group_by_camera, numbered
from desplat_ns.tools.process.process import left_out
from desplat_ns.tools.process.reconstruction import PLAIN, Attempt, Model
from desplat_ns.tools.process.video import Frame, choose


def photo(number: int, **changes) -> Photo:
    fields = {"width": 40, "height": 30, "sharpness": 100.0, **changes}
    return Photo(f"{number}.png", f"{number}.jpg", f"{number:05d}.jpg", **fields)


def test_names_that_differ_by_their_ending_do_not_meet():
    names = [named.name for named in numbered(["a.jpg", "a.png", "b/a.jpg"])]
    assert names == ["a.jpg", "a_png.jpg", "b/a.jpg"]


def test_photos_of_one_size_share_a_camera_unless_exif_says_otherwise_and_of_many_have_one_each():
    photos = [*(photo(i) for i in range(12)), photo(12, camera="A 5.0", focal_35mm=50.0)]
    assert group_by_camera(photos, "auto") == [photos[:12], photos[12:]]
    photos = [photo(i, width=40 + i // 2) for i in range(6)]
    assert len(group_by_camera(photos, "auto")) == 6
    assert len(group_by_camera(photos, "one")) == 3


def test_the_sharpest_frame_of_each_even_part_of_the_way_is_taken():
    way = [0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.4]
    sharp = [1.0, 5.0, 2.0, 3.0, 9.0, 1.0, 7.0]
    frames = [Frame(i, s, d) for i, (s, d) in enumerate(zip(sharp, way, strict=True))]
    assert [frame.index for frame in choose(frames, 2)] == [1, 4]
    assert len(choose([Frame(i, 1.0, 0.0) for i in range(9)], 5)) == 1


def test_each_photo_that_is_left_out_has_its_reason():
    photos = [photo(i, sharpness=5.0 if i == 4 else 100.0) for i in range(9)]
    features = {photo.copy: 1000 for photo in photos} | {"00005.jpg": 20}
    pairs = [("00004.jpg", "00001.jpg", 17), ("00000.jpg", "00006.jpg", 400)]
    models = [
        Model(Path(str(len(names))), names, 9, 99, 0.5)
        for names in (tuple(f"{i:05d}.jpg" for i in range(4)), ("00007.jpg",))
    ]
    left = left_out(photos, Attempt(PLAIN, models, features, pairs))
    begins = "blurred", "bare", "matches with other photos", "in another model of 1 ", "no matches"
    for (reason, sources), begin, number in zip(left.items(), begins, range(4, 9), strict=True):
        assert reason.startswith(begin) and sources == [f"{number}.png"]
