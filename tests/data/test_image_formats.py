"""Every row of the table of formats in docs/reference/data.md, by pixels that were written."""

import base64
import struct
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.images import image_size, lens_of, read_image, read_mask
from desplat_ns.data.photo_files import begin_folder

FORMATS = oiio.get_string_attribute("format_list").split(",")
CODES = np.random.default_rng(0).integers(0, 256, (6, 8, 4), dtype=np.uint8)
CODES[0, :2] = [[0, 0, 0, 255], [255, 255, 255, 255]]
RGB, GREY = CODES[..., :3], CODES[..., :1]
"""What the files show, in 8 bits."""


def light(codes: np.ndarray) -> np.ndarray:
    """Linear values of sRGB codes (IEC 61966-2-1)."""
    values = codes / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def deep(codes: np.ndarray, bits: int) -> np.ndarray:
    return np.rint(codes / 255 * (2**bits - 1)).astype(np.uint8 if bits <= 8 else np.uint16)


def write(path: Path, pixels: np.ndarray, names: str = "", **tags) -> None:
    """By OpenImageIO; names of channels are parted by spaces, `:` in tags is written `__`."""
    kind = {"float16": "half", "float32": "float"}.get(str(pixels.dtype), str(pixels.dtype))
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    if names:
        spec.channelnames = tuple(names.split())
    for name, value in tags.items():
        if hasattr(spec, name):
            setattr(spec, name, value)
        else:
            spec.attribute(name.replace("__", ":"), value)
    file = oiio.ImageOutput.create(str(path))
    assert file is not None, oiio.geterror()
    assert file.open(str(path), spec) and file.write_image(pixels.copy()), file.geterror()
    file.close()


def tiff(path: Path, samples: np.ndarray, photometric: int, order: str = "<", **more: int) -> None:
    """Uncompressed, in one strip."""
    height, width, channels = samples.shape
    content = samples.astype(samples.dtype.newbyteorder(order)).tobytes()
    values = {256: width, 257: height, 258: samples.itemsize * 8, 259: 1, 262: photometric}
    values |= {273: 8, 277: channels, 278: height, 279: len(content)}
    values |= {int(tag[1:]): value for tag, value in more.items()}
    tags = b"".join(struct.pack(f"{order}HHII", t, 4, 1, v) for t, v in sorted(values.items()))
    head = struct.pack(f"{order}2sHI", b"II" if order == "<" else b"MM", 42, 8 + len(content))
    directory = struct.pack(f"{order}H", len(values)) + tags + bytes(4)
    path.write_bytes(head + content + directory)


def psd(path: Path, samples: np.ndarray) -> None:
    height, width, channels = samples.shape
    head = struct.pack(">4sH6xHIIHH", b"8BPS", 1, channels, height, width, samples.itemsize * 8, 3)
    planes = samples.astype(samples.dtype.newbyteorder(">")).transpose(2, 0, 1).tobytes()
    path.write_bytes(head + bytes(12) + bytes(2) + planes)


def png_with(path: Path, kind: bytes, content: bytes) -> None:
    """RGB, with one more chunk before the pixels."""
    Image.fromarray(RGB).save(path)
    whole = path.read_bytes()
    chunk = kind + content
    chunk = struct.pack(">I", len(content)) + chunk + struct.pack(">I", zlib.crc32(chunk))
    path.write_bytes(whole[:33] + chunk + whole[33:])


def pnm(path: Path, magic: bytes, samples: np.ndarray, white: int) -> None:
    size = f"{samples.shape[1]} {samples.shape[0]}\n{white}\n".encode()
    path.write_bytes(magic + b"\n" + size + samples.astype(">u2").tobytes())


def pil(path: Path, pixels: np.ndarray, mode: str | None = None, **options) -> None:
    image = Image.fromarray(pixels.squeeze())
    (image.convert(mode) if mode else image).save(path, **options)


def palette(path: Path) -> None:
    Image.fromarray(RGB).quantize(16).save(path)


def heif(path: Path, pixels: np.ndarray, **options) -> None:
    written = pytest.importorskip("pillow_heif").from_pillow(Image.fromarray(pixels))
    written.save(path, quality=100, **options)


FLAT = np.full((32, 48, 3), 128, np.uint8)
"""Decodes from lossy formats to the same codes."""
LAYERS = "beauty.A beauty.B beauty.G beauty.R depth.Z"
FOUR_AND_DEPTH = np.dstack([np.ones((6, 8)), light(RGB)[..., ::-1], np.full((6, 8), 9.0)])
PALETTE = np.asarray(Image.fromarray(RGB).quantize(16).convert("RGB"))
CMYK = np.dstack([255 - RGB, np.zeros_like(GREY)])
FIFTH, FULL = np.full_like(GREY, 51), np.full_like(GREY, 255)
BITS = np.uint8(255) * (GREY > 99)
GREYS = GREY[..., [0, 0, 0]]
LINEAR, HALF = light(RGB).astype(np.float32), light(RGB).astype(np.float16)
CODED = (RGB / 255).astype(np.float32)
RGB16, GREY16 = deep(RGB, 16), deep(GREY, 16)
LINEAR16 = np.rint(light(RGB) * 65535).astype(np.uint16)


def row(shown: np.ndarray, write_it: Callable[..., None], *values: Any, **options: Any) -> Any:
    """What a file shows, and what writes it to a path."""
    return shown, lambda path: write_it(path, *values, **options)


ROWS: dict[str, tuple[np.ndarray, Callable[[Path], None]]] = {
    "jpeg.jpg": row(FLAT, pil, FLAT, quality=95),
    "jpeg grey.jpg": row(FLAT, pil, FLAT[..., 0], quality=95),
    "jpeg cmyk.jpg": row(FLAT, pil, FLAT, "CMYK", quality=95),
    "png 8.png": row(RGB, pil, RGB),
    "png 16.png": row(RGB, write, RGB16),
    "png grey alpha.png": row(
        CODES[..., [0, 0, 0, 1]], write, CODES[..., :2], "Y A", oiio__UnassociatedAlpha=1
    ),
    "png alpha.png": row(CODES, pil, CODES),
    "png 1.png": row(BITS[..., [0, 0, 0]], pil, BITS, "1"),
    "png palette.png": row(PALETTE, palette),
    "png gamma.png": row(RGB, png_with, b"gAMA", struct.pack(">I", 100_000)),
    "png linear.png": row(RGB, png_with, b"cICP", bytes([1, 8, 0, 1])),
    "tiff 8.tif": row(RGB, pil, RGB),
    "tiff lzw.tif": row(RGB, pil, RGB, compression="tiff_lzw"),
    "tiff 10.tif": row(RGB, write, RGB16, oiio__BitsPerSample=10),
    "tiff 12.tif": row(RGB, write, RGB16, oiio__BitsPerSample=12),
    "tiff 16.tif": row(RGB, write, RGB16),
    "tiff planes.tif": row(RGB, write, RGB16, planarconfig="separate"),
    "tiff tiles.tif": row(RGB, write, RGB, tile_width=16, tile_height=16),
    "tiff half.tif": row(RGB, tiff, (RGB / 255).astype(np.float16), 2, t339=3),
    "tiff float.tif": row(RGB, tiff, CODED, 2, t339=3),
    "tiff double.tif": row(RGB, tiff, RGB / 255, 2, t339=3),
    "tiff big endian.tif": row(RGB, tiff, RGB16, 2, ">"),
    "tiff white is 0.tif": row(GREYS, tiff, 255 - GREY, 0),
    "tiff white is 0, 16.tif": row(GREYS, tiff, ~GREY16, 0),
    "tiff 1.tif": row(BITS[..., [0, 0, 0]], pil, BITS, "1"),
    "tiff zip.tif": row(RGB, pil, RGB, compression="tiff_adobe_deflate"),
    "tiff packbits.tif": row(RGB, pil, RGB, compression="packbits"),
    "tiff jpeg.tif": row(FLAT, pil, FLAT, compression="jpeg", quality=95),
    "tiff ycbcr.tif": row(FLAT, pil, FLAT, "YCbCr"),
    "tiff cmyk.tif": row(RGB, tiff, CMYK, 5),
    "tiff alpha.tif": row(CODES, tiff, CODES, 2, t338=2),
    "tiff multiplied.tif": row(
        np.dstack([RGB // 5 * 5, FIFTH]), tiff, np.dstack([RGB // 5, FIFTH]), 2, t338=1
    ),
    "tiff fourth.tif": row(RGB, tiff, CODES, 2, t338=0),
    "exr half.exr": row(RGB, write, HALF),
    "exr float.exr": row(RGB, write, LINEAR),
    "exr layers.exr": row(np.dstack([RGB, FULL]), write, FOUR_AND_DEPTH.astype("f4"), LAYERS),
    "exr long names.exr": row(RGB, write, LINEAR[..., ::-1], "v.blue v.green v.red"),
    "exr grey.exr": row(GREYS, write, LINEAR[..., :1], "Y"),
    "exr says sRGB.exr": row(RGB, write, CODED, oiio__ColorSpace="sRGB"),
    "dpx 10.dpx": row(RGB, write, RGB16, oiio__BitsPerSample=10),
    "dpx 12.dpx": row(RGB, write, RGB16, oiio__BitsPerSample=12),
    "jxl 8.jxl": row(RGB, write, RGB, compression="lossless"),
    "jxl 16.jxl": row(RGB, write, RGB16, compression="lossless"),
    "jxl alpha.jxl": row(CODES, write, CODES, compression="lossless", oiio__UnassociatedAlpha=1),
    "jxl float.jxl": row(RGB, write, LINEAR, compression="lossless"),
    "jxl half.jxl": row(RGB, write, HALF, compression="lossless"),
    "jxl linear 16.jxl": row(
        RGB, write, LINEAR16, compression="lossless", oiio__ColorSpace="lin_rec709"
    ),
    "jpeg 2000.jp2": row(RGB, pil, RGB),
    "jpeg 2000 16.jp2": row(GREYS, pil, GREY16),
    "webp.webp": row(RGB, pil, RGB, lossless=True),
    "webp alpha.webp": row(CODES, pil, CODES, lossless=True, exact=True),
    "psd 8.psd": row(RGB, psd, RGB),
    "psd 16.psd": row(RGB, psd, RGB16),
    "bmp.bmp": row(RGB, pil, RGB),
    "tga.tga": row(CODES, pil, CODES),
    "ppm 10.ppm": row(RGB, pnm, b"P6", deep(RGB, 10), 1023),
    "pgm 16.pgm": row(GREYS, pnm, b"P5", GREY16, 65535),
    "pfm.pfm": row(RGB, write, CODED),
    "tga rle.tga": row(RGB, pil, RGB, compression="tga_rle"),
    "sgi.sgi": row(RGB, pil, RGB),
    "sgi 16.sgi": row(RGB, write, RGB16),
    "dpx 8.dpx": row(RGB, write, RGB),
    "dpx 16.dpx": row(RGB, write, RGB16),
    "gif.gif": row(np.dstack([PALETTE, FULL]), palette),
    "avif.avif": row(FLAT, pil, FLAT, quality=100),
    "heic.heic": row(FLAT, heif, FLAT),
}


def write_row(folder: Path, row: str) -> np.ndarray:
    """Write the file; what it shows."""
    expected, write_it = ROWS[row]
    needed = {".jxl": "jpegxl", ".jp2": "jpeg2000", ".gif": "gif"}.get(Path(row).suffix, "png")
    if needed not in FORMATS:
        pytest.skip(f"this OpenImageIO has no {needed}")
    write_it(folder / row)
    return expected


@pytest.mark.parametrize("row", ROWS)
def test_a_photo_comes_in_with_the_colours_that_were_written(tmp_path: Path, row: str):
    expected = write_row(tmp_path, row)
    np.testing.assert_array_equal(read_image(tmp_path / row), expected)
    assert image_size(tmp_path / row) == expected.shape[1::-1]


def test_a_palette_of_tiff_is_followed(tmp_path: Path):
    palette(tmp_path / "a.tif")
    # Pillow writes 256 times the codes, where the format has 257 times.
    assert np.abs(read_image(tmp_path / "a.tif").astype(int) - PALETTE).max() <= 1


def test_radiance_of_shared_exponents_keeps_eight_bits_of_the_brightest(tmp_path: Path):
    write(tmp_path / "a.hdr", LINEAR[..., [0, 0, 0]])
    # A grey value loses 2^-8 of itself: 255 * 1.055 / 2.4 * 2^-8 = 0.44 codes, and rounding.
    assert np.abs(read_image(tmp_path / "a.hdr").astype(int) - GREY).max() <= 1


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("ending", ["jpg", "png", "tif", "webp", "avif"])
def test_a_photo_is_upright_and_for_its_camera_as_stored(
    tmp_path: Path, orientation: int, ending: str
):
    """What is red, the top left eighth, goes where EXIF 2.3 (tag 0x0112) says."""
    stored = np.zeros((32, 64, 3), np.uint8)
    stored[:16, :16, 0] = 255
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"a.{ending}"
    Image.fromarray(stored).save(path, exif=exif, quality=95)
    corners = 2 * ["top left", "top right", "bottom right", "bottom left"]
    rows, columns = (32, 64) if orientation < 5 else (64, 32)
    top = slice(0, 16) if "top" in corners[orientation - 1] else slice(rows - 16, rows)
    left = slice(0, 16) if "left" in corners[orientation - 1] else slice(columns - 16, columns)
    upright = np.zeros((rows, columns), bool)
    upright[top, left] = True
    np.testing.assert_array_equal(read_image(path)[..., 0] > 127, upright)
    assert image_size(path) == (columns, rows)
    np.testing.assert_array_equal(read_image(path, (64, 32))[..., 0] > 127, stored[..., 0] > 127)
    turned = upright if orientation >= 5 else stored[..., 0] > 127
    np.testing.assert_array_equal(read_image(path, (32, 64))[..., 0] > 127, turned)


@pytest.mark.skipif("jpegxl" not in FORMATS, reason="this OpenImageIO has no JPEG XL")
def test_jpeg_xl_comes_as_its_decoder_turns_it(tmp_path: Path):
    """Orientation 6 in the codestream; its decoder gives what is upright, for a camera too."""
    content = (
        "/woPLRADCAABAEgCSxiTjoODKTCiQNyZWfdeIDCAtN4AAD3Slpsl0QFYd37UeFs6Xyp7XMZ2h7O84xELzA/slImj"
        "tOJhm7O8wAS/jPy0vpH8HXRvHG99BCjZMoIb5DrJwMyze0Vf96qTuvXJV/62tTezkmEQGMDiMuo7hjzCxHZSHcyz"
        "xv1vmAhwsgTbzWyUHbA4R8z4W9kA/Zj3cjc="
    )
    (tmp_path / "a.jxl").write_bytes(base64.b64decode(content))
    noise = np.random.default_rng(1).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    upright = np.rot90(noise.repeat(16, 0).repeat(16, 1), -1)
    for camera in (None, (64, 96), (96, 64)):
        np.testing.assert_array_equal(read_image(tmp_path / "a.jxl", camera), upright)
        assert image_size(tmp_path / "a.jxl", camera) == (64, 96)


def test_heic_comes_as_its_decoder_turns_it_and_files_are_what_they_hold(tmp_path: Path):
    """Orientation 6: upright the picture is a quarter turn to the right."""
    stored, exif = FLAT.copy(), Image.Exif()
    stored[:16, :16], exif[0x0112] = 0, 6
    for name in ("a.heic", "b.HEIF"):
        heif(tmp_path / name, stored, exif=exif.tobytes())
    (tmp_path / "b.HEIF").rename(tmp_path / "c.jpg")
    for name in ("a.heic", "c.jpg"):
        read = read_image(tmp_path / name)
        np.testing.assert_array_equal(read > 64, np.rot90(stored, -1) > 64)
        assert image_size(tmp_path / name) == (32, 48)
    Image.fromarray(FLAT).save(tmp_path / "jpeg.jpg")
    path = (tmp_path / "jpeg.jpg").rename(tmp_path / "jpeg.heic")
    np.testing.assert_array_equal(read_image(path), FLAT)


def test_where_heic_cannot_be_read_the_library_is_named(tmp_path: Path, monkeypatch):
    (tmp_path / "a.heic").write_bytes(b"\0\0\0\x18ftypheic")
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(CaptureError, match="pip install pillow-heif"):
        read_image(tmp_path / "a.heic")
    assert lens_of(tmp_path / "a.heic").name == ""


@pytest.mark.parametrize("ending", ["jpg", "png", "webp", "tif", "heic"])
def test_the_lens_is_read_from_every_format_with_exif(tmp_path: Path, ending: str):
    path = tmp_path / f"a.{ending}"
    if ending == "tif":  # Pillow writes no inner tags there
        inner = {"Exif__LensModel": "85mm", "Exif__FocalLength": 4.25}
        write(path, FLAT, Make="Apple", Exif__FocalLengthIn35mmFilm=26, **inner)
    else:
        exif = Image.Exif()
        exif[0x010F] = "Apple"
        exif.get_ifd(0x8769).update({0xA434: "85mm", 0x920A: IFDRational(17, 4), 0xA405: 26})
        (heif if ending == "heic" else pil)(path, FLAT, exif=exif.tobytes())
    assert lens_of(path) == ("Apple 85mm 4.25", 26.0)


def test_a_windowed_photo_is_read_where_it_is_shown(tmp_path: Path):
    """Half of the pixels lie left of the display window, whose right is empty: black."""
    write(tmp_path / "a.exr", LINEAR, x=-4, y=1, full_x=0, full_y=0, full_width=10, full_height=7)
    expected = np.zeros((7, 10, 3), np.uint8)
    expected[1:, :4] = RGB[:, 4:]
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr"), expected)
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr", (8, 6)), RGB)
    assert image_size(tmp_path / "a.exr") == (10, 7)


def test_of_several_parts_the_first_with_colours_is_read(tmp_path: Path):
    parts = [("Z", np.ones((6, 8, 1), np.float32)), ("R G B", LINEAR)]
    specs = []
    for names, pixels in parts:
        specs.append(oiio.ImageSpec(8, 6, pixels.shape[2], "float"))
        specs[-1].channelnames = tuple(names.split())
    file = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    assert file is not None
    assert file.open(str(tmp_path / "a.exr"), tuple(specs)) and file.write_image(parts[0][1])
    assert file.open(str(tmp_path / "a.exr"), specs[1], "AppendSubimage")
    assert file.write_image(parts[1][1])
    file.close()
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr"), RGB)


@pytest.mark.parametrize(("scale", "stops"), [(1, 0), (0.01, 6), (1000, -10), (0.3, 0), (1.05, 0)])
def test_photos_of_a_capture_have_one_exposure(
    tmp_path: Path, scale: float, stops: int, capsys: pytest.CaptureFixture[str]
):
    """A photo that is dark by itself is as dark as it was beside the others."""
    for name, factor in (("day1/a", 1), ("day1/b", 1), ("night/c", 1 / 64)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        values = (light(RGB) * factor * scale).astype(np.float32)
        values[5, 7] = np.nan if name == "day1/a" else values[5, 7]
        write(tmp_path / f"{name}.exr", values)
    begin_folder(tmp_path, [])
    values = np.clip(light(RGB) / 64 * scale * 2.0**stops, 0, 1)
    curve = np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)
    read = read_image(tmp_path / "night" / "c.exr")
    # Rounding, and float32: 2^-23 of a value, 255 times.
    assert np.abs(read - 255 * curve).max() <= 0.5 + 1e-3
    assert f"2^{stops}:" in capsys.readouterr().out


def test_lights_above_white_are_clipped_and_counted(tmp_path: Path, capsys):
    values = np.full((10, 20, 3), 0.5, np.float32)
    values[0, 0], values[0, 1], values[0, 2] = 50, np.inf, np.nan
    write(tmp_path / "a.exr", values)
    # 1.055 * 0.5 ** (1 / 2.4) - 0.055 = 0.73536, times 255 = 187.5
    assert read_image(tmp_path / "a.exr")[0, :4, 0].tolist() == [255, 255, 0, 188]
    assert "1.00%" in capsys.readouterr().out
    write(tmp_path / "nan.exr", np.full((2, 2, 3), np.nan, np.float32))
    with pytest.raises(CaptureError, match=r"nan\.exr .*finite"):
        read_image(tmp_path / "nan.exr")


@pytest.mark.parametrize("kind", ["uint16", "float32", "uint8"])
def test_a_mask_is_read_at_its_full_depth(tmp_path: Path, kind: str):
    path = tmp_path / ("a.tif" if kind == "float32" else "a.png")
    values = np.array([[[0], [1], [0]]], kind) * (1e-4 if kind == "float32" else 1)
    write(path, values.astype(kind))
    assert read_mask(path).tolist() == [[False, True, False]]


FOREIGN = {
    "a.jpg": (b"", "empty"),
    "b.jpg": (b"version https://git-lfs.github.com/spec/v1\noid sha256:0", "git LFS"),
    "c.jpg": (b"<!DOCTYPE html><html>", "HTML"),
    "d.jpg": (b"%PDF-1.7", "PDF"),
    "e.tif": (b"II*\0\x10\0\0\0CR\x02\0", "CR2"),
    "f.tif": (b"II*\0\x08\0\0\0\x01\0\x12\xc6\x01\0\x04\0\0\0\x01\x04\0\0", "DNG"),
    "g.heic": (b"\0\0\0\x18ftypcrx \0\0\0\x01crx isom", "CR3"),
    "h.png": (b"\0\0\0\x18ftypisom\0\0\0\x01isom", "video"),
    "i.png": (b"hello", "known format|format that is not read"),
    "j.png": (b"\xff\xd8\xff\xe0\0\x10JFIF\0", "JPEG"),
    "k.jpg": (b"\x89PNG\r\n\x1a\n", "PNG"),
    "l.jpg": (b"\0\0\0\x18ftypavif\0\0\0\0avifmif1", "AVIF"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_an_error_names_what_the_file_is(tmp_path: Path, name: str):
    content, what = FOREIGN[name]
    (tmp_path / name).write_bytes(content)
    for read in (read_image, image_size, read_mask):
        with pytest.raises(CaptureError, match=rf"{name} cannot be read: .*({what})"):
            read(tmp_path / name)
    assert lens_of(tmp_path / name) == ("", 0.0)


def test_a_format_that_this_openimageio_lacks_is_named_with_the_cure(tmp_path: Path, monkeypatch):
    (tmp_path / "a.jpg").write_bytes(b"\0\0\0\x0cJXL \r\n\x87\n")
    monkeypatch.setattr(oiio, "get_string_attribute", lambda _: "openexr,tiff,jpeg,png")
    with pytest.raises(CaptureError, match=r"JPEG XL.*pip install --no-deps"):
        read_image(tmp_path / "a.jpg")


@pytest.mark.parametrize("row", [row for row in ROWS if "alpha" not in row and "grey" not in row])
@pytest.mark.parametrize("share", [0.5, 0.95])
def test_half_of_a_file_is_an_error_or_all_of_its_pixels(tmp_path: Path, row: str, share: float):
    expected = write_row(tmp_path, row)
    whole = (tmp_path / row).read_bytes()
    (tmp_path / row).write_bytes(whole[: int(len(whole) * share)])
    try:
        np.testing.assert_array_equal(read_image(tmp_path / row), expected)
    except CaptureError as error:
        assert str(tmp_path / row) in str(error)


def test_bytes_that_a_decoder_passes_over_do_no_harm(tmp_path: Path):
    Image.fromarray(FLAT).save(tmp_path / "a.jpg", quality=95)
    whole = (tmp_path / "a.jpg").read_bytes()
    table = whole.index(b"\xff\xdb")
    (tmp_path / "a.jpg").write_bytes(whole[:table] + bytes(3) + whole[table:] + b"more")
    np.testing.assert_array_equal(read_image(tmp_path / "a.jpg"), FLAT)
