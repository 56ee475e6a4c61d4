"""iPhones' photos come in as JPEG does: upright, with their colours and their lens."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.images import image_size, lens_of, read_image

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
    exif.get_ifd(EXIF).update({FOCAL: IFDRational(17, 4), FOCAL_35: 26})
    if path.suffix == ".jpg":
        image.save(path, quality=98, exif=exif)
    else:
        pillow_heif.from_pillow(image).save(path, quality=100, exif=exif.tobytes())
    return path


@pytest.mark.parametrize("name", ["a.heic", "a.HEIC", "a.heif", "heic.jpg", "a.jpg", "jpeg.heic"])
def test_a_photo_keeps_its_colours_and_its_lens_whatever_it_is_called(tmp_path: Path, name: str):
    written = {"heic.jpg": "a.heic", "jpeg.heic": "a.jpg"}.get(name, name)
    path = write(tmp_path / written).rename(tmp_path / name)
    read = read_image(path)
    assert read.shape == (40, 64, 3) and image_size(path) == (64, 40)
    assert abs(read.astype(int) - photo()).mean() < 5  # the formats lose some
    assert lens_of(path) == ("Apple 4.25", 26.0)


def test_a_photo_is_upright(tmp_path: Path):
    """Orientation 6: the camera was turned; upright the picture is a quarter turn to the right."""
    path = write(tmp_path / "a.heic", orientation=6)
    read = read_image(path)
    assert read.shape == (64, 40, 3) and image_size(path) == (40, 64)
    assert abs(read.astype(int) - np.rot90(photo(), -1)).mean() < 5


def test_where_it_cannot_be_read_the_library_is_named(tmp_path: Path, monkeypatch):
    path = tmp_path / "a.heic"
    path.write_bytes(b"\0\0\0\x18ftypheic")
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(CaptureError, match="pip install pillow-heif"):
        read_image(path)
    assert lens_of(path).name == ""
