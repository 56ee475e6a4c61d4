"""iPhones' photos come in as JPEG does: upright, with their colours and their lens."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from desplat_ns.data.exif import lens_of
from desplat_ns.data.images import image_size, read_image
from desplat_ns.errors import CaptureError

MAKE, ORIENTATION, EXIF, FOCAL, FOCAL_35 = 0x010F, 0x0112, 0x8769, 0x920A, 0xA405


def photo() -> np.ndarray:
    """Wide; red on the left, blue on the right."""
    pixels = np.zeros((40, 64, 3), np.uint8)
    pixels[:, :32, 0], pixels[:, 32:, 2] = 200, 200
    return pixels


def write(path: Path, orientation: int = 1) -> Path:
    pillow_heif = pytest.importorskip("pillow_heif")
    image, exif = Image.fromarray(photo()), Image.Exif()
    exif[MAKE], exif[ORIENTATION] = "Apple", orientation
    exif.get_ifd(EXIF).update({FOCAL: 4.25, FOCAL_35: 26})
    pillow_heif.from_pillow(image).save(path, quality=100, exif=exif.tobytes())
    return path


@pytest.mark.parametrize("name", ["a.heic", "a.HEIC", "a.heif"])
def test_a_photo_keeps_its_colours(tmp_path, name):
    path = write(tmp_path / name)
    read = read_image(path)
    assert read.shape == (40, 64, 3) and image_size(path) == (64, 40)
    assert abs(read.astype(int) - photo()).mean() < 5  # the format loses some


def test_a_photo_is_upright(tmp_path):
    """Orientation 6: the camera was turned; upright the picture is a quarter turn to the right."""
    path = write(tmp_path / "a.heic", orientation=6)
    read = read_image(path)
    assert read.shape == (64, 40, 3) and image_size(path) == (40, 64)
    assert abs(read.astype(int) - np.rot90(photo(), -1)).mean() < 5


def test_its_lens_is_known(tmp_path):
    lens = lens_of(write(tmp_path / "a.heic"))
    assert lens.name.startswith("Apple") and lens.focal_35mm == 26


@pytest.mark.parametrize("read", [read_image, image_size])
@pytest.mark.parametrize("content", [None, b"", b"no photo"])
def test_what_is_damaged_is_named(tmp_path, read, content):
    path = tmp_path / "a.heic"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CaptureError, match=r"a\.heic cannot be read"):
        read(path)
    assert lens_of(path).focal_35mm == 0


def test_what_a_file_is_decides_and_not_its_name(tmp_path):
    Image.fromarray(photo()).save(tmp_path / "a.jpg")
    (tmp_path / "a.jpg").rename(tmp_path / "jpeg.heic")
    write(tmp_path / "a.heic").rename(tmp_path / "heic.jpg")
    for name in ("jpeg.heic", "heic.jpg"):
        assert image_size(tmp_path / name) == (64, 40)
        assert abs(read_image(tmp_path / name).astype(int) - photo()).mean() < 5


def test_where_it_cannot_be_read_the_library_is_named(tmp_path, monkeypatch):
    path = tmp_path / "a.heic"
    path.write_bytes(b"\0\0\0\x18ftypheic")
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(CaptureError, match=r"pip install pillow-heif"):
        read_image(path)
    assert lens_of(path).name == ""
