"""Photos come in upright and with their own colours; damage is named."""

from __future__ import annotations

import os
import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageOps

from desplat_ns.data.images import (
    image_size,
    read_image,
    read_mask,
    resize_image,
    resize_mask,
    write_image,
)
from desplat_ns.errors import CaptureError, DeSplatError


def noise(height: int, width: int, channels: int = 3, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, channels), dtype=np.uint8)


def area_mean(image: np.ndarray, width: int, height: int) -> np.ndarray:
    """Independent reference: overlap lengths of every old and new pixel, float64."""

    def overlaps(old: int, new: int) -> np.ndarray:
        ratio = old / new
        edges = np.arange(new)[:, None] * ratio
        left = np.maximum(np.arange(old)[None], edges)
        right = np.minimum(np.arange(old)[None] + 1, edges + ratio)
        return np.maximum(right - left, 0) / ratio

    rows, columns = overlaps(image.shape[0], height), overlaps(image.shape[1], width)
    return np.einsum("yh,xw,hwc->yxc", rows, columns, image.astype(np.float64))


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


def test_a_jpeg_decodes_as_in_pil(tmp_path: Path):
    path = tmp_path / "photo.jpg"
    Image.fromarray(noise(32, 48)).save(path, quality=90)
    with Image.open(path) as stored:
        expected = np.asarray(stored).astype(int)
    # One step of 8 bits: decoders may round the inverse DCT differently.
    assert np.abs(read_image(path).astype(int) - expected).max() <= 1


@pytest.mark.parametrize(("channels", "mode"), [(1, "L"), (2, "LA"), (4, "RGBA")])
def test_grey_becomes_three_equal_channels_and_alpha_is_kept_as_it_is(
    tmp_path: Path, channels: int, mode: str
):
    pixels = noise(4, 5, channels)
    Image.fromarray(pixels.squeeze(), mode=mode).save(tmp_path / "a.png")
    expected = {1: [0, 0, 0], 2: [0, 0, 0, 1], 4: [0, 1, 2, 3]}[channels]
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), pixels[..., expected])


def test_16_bit_samples_are_divided_by_257(tmp_path: Path):
    # 65535 = 255 * 257; 257 k + 128 lies below the middle of k and k + 1, 257 k + 129 above it.
    samples = np.array([[0, 257, 257 * 100 + 128, 257 * 100 + 129, 65535]], dtype=np.uint16)
    Image.fromarray(samples).save(tmp_path / "deep.png")
    assert read_image(tmp_path / "deep.png")[0, :, 0].tolist() == [0, 1, 100, 101, 255]


def test_linear_floats_get_the_srgb_curve_and_no_nan(tmp_path: Path):
    path = floats(tmp_path / "light.exr", [0.0, 0.5, 1.0, 7.0, np.nan])
    # 1.055 * 0.5 ** (1 / 2.4) - 0.055 = 0.73536, times 255 = 187.5
    assert read_image(path)[0, :, 0].tolist() == [0, 188, 255, 255, 0]


def test_floats_that_are_not_said_to_be_linear_keep_their_values(tmp_path: Path):
    assert read_image(floats(tmp_path / "float.tif", [0.2, 0.6]))[0, :, 0].tolist() == [51, 153]


def floats(path: Path, values: list[float], channels: int = 3) -> Path:
    """One row of grey pixels."""
    file = oiio.ImageOutput.create(str(path))
    file.open(str(path), oiio.ImageSpec(len(values), 1, channels, oiio.FLOAT))
    file.write_image(np.repeat(np.array(values, np.float32)[None, :, None], channels, -1))
    file.close()
    return path


def png_of(width: int, height: int) -> bytes:
    """A PNG that says that it has a size, and has 30 rows."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    rows = zlib.compress(bytes(30 * (1 + 3 * width)))
    parts = (b"IHDR", header), (b"IDAT", rows), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def jpeg_of(width: int, height: int) -> bytes:
    content = BytesIO()
    Image.fromarray(noise(64, 64)).save(content, "JPEG")
    before, after = content.getvalue().split(b"\xff\xc0\x00\x11\x08", 1)
    return before + b"\xff\xc0\x00\x11\x08" + struct.pack(">HH", height, width) + after[4:]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.png", png_of(60_000, 40_000)),
        ("a.jpg", jpeg_of(65_000, 65_000)),
        ("a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n" + bytes(99)),
    ],
    ids=["png", "jpg", "hdr"],
)
def test_a_header_that_says_too_much_is_refused_before_pixels_take_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: bytes
):
    (tmp_path / name).write_bytes(content)
    monkeypatch.setattr(oiio.ImageInput, "read_image", None)
    for read in (read_image, image_size):
        with pytest.raises(CaptureError, match=f"{name} .*000x"):
            read(tmp_path / name)


def test_a_named_pipe_is_no_photo_and_many_channels_need_names(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.jpg")
    for read in (read_image, image_size):
        with pytest.raises(CaptureError, match=r"pipe\.jpg"):
            read(tmp_path / "pipe.jpg")
    assert read_image(floats(tmp_path / "many.exr", [0.0, 1.0], 100)).shape == (1, 2, 4)
    with pytest.raises(CaptureError, match=r"nan\.exr .*finite"):
        read_image(floats(tmp_path / "nan.exr", [np.nan]))


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


@pytest.mark.parametrize(("width", "height"), [(4, 3), (2, 6), (5, 4), (7, 5), (8, 1)])
def test_reducing_takes_the_mean_of_the_covered_area(width: int, height: int):
    image = noise(6, 8)
    reduced = resize_image(image, width, height)
    # Half a step for rounding, and as much again for float32 sums that fall on the other side.
    assert np.abs(reduced - area_mean(image, width, height)).max() <= 0.5 + 48 * 255 * 2**-23


@given(
    value=st.integers(0, 255),
    height=st.integers(2, 9),
    width=st.integers(2, 9),
    data=st.data(),
    channels=st.sampled_from([3, 4]),
)
def test_reducing_keeps_a_constant_colour(value, height, width, data, channels):
    image = np.full((height, width, channels), max(value, 1), dtype=np.uint8)
    new = data.draw(st.integers(1, width)), data.draw(st.integers(1, height))
    assert (resize_image(image, *new) == max(value, 1)).all()


def test_what_is_transparent_does_not_bleed():
    image = np.array([[[200, 0, 0, 255], [0, 255, 0, 0]]], dtype=np.uint8)
    assert resize_image(image, 1, 1)[0, 0].tolist() == [200, 0, 0, 128]


def test_a_reduced_mask_is_true_where_half_the_area_is():
    mask = np.array([[1, 1, 1, 0], [0, 0, 0, 0]], dtype=bool)
    assert resize_mask(mask, 2, 1).tolist() == [[True, False]]


def test_a_mask_is_where_the_picture_is_not_black(tmp_path: Path):
    Image.fromarray(np.array([[0, 1, 255]], dtype=np.uint8)).save(tmp_path / "mask.png")
    assert read_mask(tmp_path / "mask.png").tolist() == [[False, True, True]]


@pytest.mark.parametrize(
    ("pixels", "expected"),
    [
        ([[2], [2], [255]], [False, False, True]),
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


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_what_is_written_reads_back(tmp_path: Path, channels: int):
    image = noise(4, 5, channels)
    path = tmp_path / "new" / "picture.png"
    write_image(path, image)
    expected = np.repeat(image, 3, -1) if channels == 1 else image
    np.testing.assert_array_equal(read_image(path), expected)


def test_floats_and_booleans_are_written_as_8_bits(tmp_path: Path):
    write_image(tmp_path / "f.png", np.array([[[-1.0], [0.2], [2.0]]], dtype=np.float64))
    write_image(tmp_path / "b.png", np.array([[True, False]]))
    assert read_image(tmp_path / "f.png")[0, :, 0].tolist() == [0, 51, 255]
    assert read_image(tmp_path / "b.png")[0, :, 0].tolist() == [255, 0]


def test_a_picture_that_cannot_be_written_is_named(tmp_path: Path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DeSplatError, match=r"p\.png"):
        write_image(tmp_path / "file" / "p.png", noise(2, 2))
    with pytest.raises(DeSplatError, match=r"p\.nonsense"):
        write_image(tmp_path / "p.nonsense", noise(2, 2))
