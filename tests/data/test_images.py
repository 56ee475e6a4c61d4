"""Photos come in upright and with their own colours; damage is named."""

from __future__ import annotations

import os
import struct
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps

from desplat_ns.data.images import (
    image_size,
    read_image,
    read_mask,
    resize_image,
)
from desplat_ns.errors import CaptureError


def noise(height: int, width: int, channels: int = 3, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, channels), dtype=np.uint8)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_exif_orientation_comes_in_as_pil_shows_it(tmp_path: Path, orientation: int):
    path = tmp_path / "turned.png"
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(noise(6, 8)).save(path, exif=exif)
    with Image.open(path) as stored:
        expected = np.asarray(ImageOps.exif_transpose(stored))
    np.testing.assert_array_equal(read_image(path), expected)
    assert image_size(path) == (expected.shape[1], expected.shape[0])


@pytest.mark.parametrize(("channels", "mode"), [(1, "L"), (2, "LA"), (4, "RGBA")])
def test_grey_becomes_three_equal_channels_and_alpha_is_kept_as_it_is(
    tmp_path: Path, channels: int, mode: str
):
    pixels = noise(4, 5, channels)
    Image.fromarray(pixels.squeeze(), mode=mode).save(tmp_path / "a.png")
    expected = {1: [0, 0, 0], 2: [0, 0, 0, 1], 4: [0, 1, 2, 3]}[channels]
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), pixels[..., expected])


@pytest.mark.parametrize("mode", ["grey.png", "rgb.png", "rgb.tif"])
def test_samples_of_16_bits_come_as_8(tmp_path: Path, mode: str):
    samples = np.array([[0, 257, 257 * 100, 65535]], dtype=np.uint16)
    samples = samples if mode == "grey.png" else np.repeat(samples[..., None], 3, -1)
    cv2.imwrite(str(tmp_path / mode), samples)
    assert read_image(tmp_path / mode)[0, :, 0].tolist() == [0, 1, 100, 255]


def jpeg_of(width: int, height: int) -> bytes:
    """A JPEG of 64 x 64 pixels that says that it has another size."""
    content = BytesIO()
    Image.fromarray(noise(64, 64)).save(content, "JPEG")
    before, after = content.getvalue().split(b"\xff\xc0\x00\x11\x08", 1)
    return before + b"\xff\xc0\x00\x11\x08" + struct.pack(">HH", height, width) + after[4:]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("width", [20_000, 65_000])
def test_a_header_that_says_too_much_is_refused_before_pixels_take_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int
):
    (tmp_path / "a.jpg").write_bytes(jpeg_of(width, 20_000))
    monkeypatch.setattr(Image.Image, "load", None)
    for read in (read_image, image_size):
        with pytest.raises(CaptureError, match=r"a\.jpg .*pixels"):
            read(tmp_path / "a.jpg")


def test_a_named_pipe_and_samples_of_32_bits_are_no_photo(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.jpg")
    for read in (read_image, image_size):
        with pytest.raises(CaptureError, match=r"pipe\.jpg"):
            read(tmp_path / "pipe.jpg")
    Image.fromarray(np.ones((2, 2), np.float32)).save(tmp_path / "float.tif")
    with pytest.raises(CaptureError, match=r"float\.tif"):
        read_image(tmp_path / "float.tif")


@pytest.mark.parametrize("damage", ["cut", "header", "text", "empty", "missing"])
def test_a_damaged_or_missing_photo_is_named(tmp_path: Path, damage: str):
    path = tmp_path / "broken.jpg"
    Image.fromarray(noise(64, 64)).save(path)
    whole = path.read_bytes()
    half = whole[: len(whole) // 2]
    path.write_bytes({"cut": half, "header": whole[:40], "text": b"hello"}.get(damage, b""))
    if damage == "missing":
        path.unlink()
    with pytest.raises(CaptureError, match=r"broken\.jpg"):
        read_image(path)


def test_what_is_transparent_does_not_bleed():
    image = np.array([[[200, 0, 0, 255], [0, 255, 0, 0]]], dtype=np.uint8)
    assert resize_image(image, 1, 1)[0, 0].tolist() == [200, 0, 0, 128]


@pytest.mark.parametrize(
    ("pixels", "expected"),
    [
        ([[0], [1], [255]], [False, True, True]),
        ([[255, 255], [255, 0], [255, 255]], [True, False, True]),
        ([[255, 255, 255, 255], [255, 255, 255, 0], [0, 0, 0, 255]], [True, False, False]),
        ([[0, 0, 0, 255], [0, 0, 0, 0], [0, 0, 0, 255]], [True, False, True]),
        ([[0, 0, 0, 255]] * 3, [False] * 3),
        ([[255, 0]] * 3, [False] * 3),
    ],
)
def test_black_may_be_transparent_or_dark(tmp_path: Path, pixels, expected: list[bool]):
    values = np.array([pixels], dtype=np.uint8)
    Image.fromarray(values.squeeze(-1) if values.shape[2] == 1 else values).save(tmp_path / "m.png")
    assert read_mask(tmp_path / "m.png").tolist() == [expected]


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("camera", [(8, 6), (6, 8)])
def test_a_camera_gets_pixels_as_stored_unless_a_quarter_turn_makes_them_fit(
    tmp_path: Path, orientation: int, camera: tuple[int, int]
):
    path, pixels, exif = tmp_path / "photo.png", noise(6, 8), Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(pixels).save(path, exif=exif)
    is_turned = camera == (6, 8) and orientation >= 5
    expected = read_image(path) if is_turned else pixels
    np.testing.assert_array_equal(read_image(path, camera), expected)
    assert image_size(path, camera) == expected.shape[1::-1]
