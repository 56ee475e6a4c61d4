"""Photos as pixels: 8 bit, RGB or RGBA; masks; and what files say of their lens.

Read by OpenImageIO; HEIC and AVIF, which its wheels lack, by Pillow and pillow-heif. The formats
are in docs/reference/data.md.

Letters in shapes: H x W pixels, C channels.
"""

import math
import re
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from itertools import count
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import cv2
import numpy as np
import OpenImageIO as oiio
import torch
from jaxtyping import Bool, Float32, UInt8
from PIL import ExifTags, Image
from torch import Tensor

from desplat_ns.core.console import announce
from desplat_ns.core.errors import CaptureError
from desplat_ns.data.photo_files import exposed_together, file_names

MOST_PIXELS = 1 << 28
"""Of a photo, 16,384 x 16,384; one whose header says more is not decoded."""

FLOAT_SUFFIXES = (".exr", ".hdr", ".tif", ".tiff", ".jxl", ".pfm", ".dpx", ".psd")
"""Of files whose samples may be floating point."""
EXPOSED_FILES = 9
"""Photos by which the exposure of a capture is found."""
GT_LEVEL = 0.5
"""Share of white above which a true mask counts; in a mask without any such, all above black."""

_LENS, _FOCAL, _FOCAL_35MM = "Exif:LensModel", "Exif:FocalLength", "Exif:FocalLengthIn35mmFilm"
_LOCK = Lock()

_KINDS = {
    "an empty file": rb"\Z",
    "a pointer of git LFS (`git lfs pull` brings the photo)": rb"version https://git-lfs",
    "an HTML page, perhaps of a failed download": rb"(\xef\xbb\xbf)?\s*<(!doctype )?html",
    "a PDF": rb"%PDF",
    "a raw photo (Canon CR2), to be developed": rb"II\*\0.{4}CR",
    "a raw photo (Canon CR3), to be developed": rb".{4}ftypcrx",
    "a raw photo (DNG), to be developed": rb"II\*\0.*\x12\xc6\x01\0\x04|MM\0\*.*\xc6\x12\0\x01\0\0",
    "a raw photo of a camera, to be developed": rb"FUJIFILMCCD-RAW|IIR[OS]|MMOR|IIU\0",
    "HEIC": rb".{4}ftyp(hei[cxms]|hev[cx]|mif1|msf1)",
    "AVIF": rb".{4}ftypavi[fs]",
    "a video": rb".{4}ftyp|\x1aE\xdf\xa3|RIFF.{4}AVI ",
    "JPEG": rb"\xff\xd8\xff",
    "PNG": rb"\x89PNG",
    "TIFF": rb"II[*+]\0|MM\0[*+]",
    "OpenEXR": rb"v/1\x01",
    "HDR": rb"#\?",
    "WebP": rb"RIFF.{4}WEBP",
    "JPEG XL": rb"\xff\x0a|\0{3}\x0cJXL ",
    "JPEG 2000": rb"\xff\x4f\xff\x51|\0{3}\x0cjP  ",
    "GIF": rb"GIF8",
    "BMP": rb"BM",
    "DPX": rb"SDPX|XPDS",
    "PSD": rb"8BPS",
}
"""What a file is, by its first bytes; with an article: none that is read."""


class Lens(NamedTuple):
    """What a photo was taken with, as its file gives it: often absent, sometimes wrong."""

    name: str = ""
    """Make, model, lens and focal length in millimetres; empty where the file says nothing."""
    focal_35mm: float = 0.0
    """Millimetres, as on 35 mm film; 0 where the file does not say."""


class _Photo(NamedTuple):
    """An open file."""

    spec: Any
    """Its header (`ImageSpec`), of the part that is read."""
    read: Callable[[Any], np.ndarray]
    """RGB or RGBA as stored, in a type of OpenImageIO's, turned; grey in three channels."""
    size: tuple[int, int]
    """(width, height) of what `read` gives."""
    is_float: bool
    is_linear: bool
    """Whether the file says so; of PNG not, as no other program follows it there."""
    is_multiplied: bool
    """Whether colours are multiplied by alpha."""


def read_image(path: Path, camera: tuple[int, int] | None = None) -> UInt8[np.ndarray, "H W C"]:
    """The photo, RGB (C = 3) or RGBA (C = 4).

    Without a camera it is turned as EXIF says. For a camera, given by width and height, pixels come
    as they are stored, as COLMAP and nerfstudio read them; they are turned only where EXIF names a
    quarter turn without which they do not have the camera's shape.

    Grey becomes RGB; samples of any depth are reduced to 8 bits. In floating point, all photos of a
    capture have one exposure, and linear ones get the sRGB curve (IEC 61966-2-1). Colours are not
    multiplied by alpha. Colour profiles are not followed. Raises CaptureError: the file is missing,
    damaged or no picture, or has more than `MOST_PIXELS`, integers of 32 bits, CIELAB colours, or
    no finite value.
    """
    photo = _open(path, camera)
    if photo.spec.format.basetype in (oiio.INT, oiio.UINT):
        raise _unreadable(path, "its samples are integers of 32 bits, and photos have 8 or 16")
    if not (photo.is_float or photo.is_linear or photo.is_multiplied):
        return np.ascontiguousarray(photo.read(oiio.UINT8))
    values = _light(path, photo)
    if photo.is_float:
        with _LOCK:  # photos are read by several threads
            values[..., :3] *= _exposure(exposed_together(path))
    values = values.clip(0, 1)
    if photo.is_linear:
        colors = values[..., :3]
        curve = 1.055 * np.maximum(colors, 0.0031308) ** (1 / 2.4) - 0.055
        values[..., :3] = np.where(colors <= 0.0031308, 12.92 * colors, curve)
    return np.rint(values * 255).astype(np.uint8)


def image_size(path: Path, camera: tuple[int, int] | None = None) -> tuple[int, int]:
    """(width, height) in pixels, turned as `read_image` does it; reads the header only. Raises
    CaptureError where that is missing, no image's, or says more than `MOST_PIXELS`."""
    return _open(path, camera).size


def lens_of(path: Path) -> Lens:
    """What the file says about camera and lens; nothing where it is missing or is no photo."""
    try:
        tags = _open(path).spec
    except CaptureError:
        return Lens()
    names = [tags.get_string_attribute(tag).strip("\0 ") for tag in ("Make", "Model", _LENS)]
    focal, focal_35mm = (tags.get_float_attribute(tag) for tag in (_FOCAL, _FOCAL_35MM))
    names += [f"{focal:g}"] if focal else []
    return Lens(" ".join(filter(None, names)), focal_35mm if 0 < focal_35mm < math.inf else 0.0)


def read_mask(path: Path, camera: tuple[int, int] | None = None) -> Bool[np.ndarray, "H W"]:
    """Where the mask, at its full depth, is neither black nor transparent, turned as `read_image`
    does it. Of a mask that is black all over alpha alone counts. Raises as `read_image`."""
    above = _open(path, camera).read(oiio.UNKNOWN) > 0
    colors, opaque = above[..., :3].any(axis=-1), above[..., 3:].all(axis=-1)
    return colors & opaque if colors.any() else opaque & ~opaque.all()


def read_gt_mask(path: Path, width: int, height: int) -> Bool[Tensor, "h w 1"]:
    """A true mask of distractors (white) at the given size in pixels, nearest neighbour: which
    pixels' grey (Rec. 601) is above `GT_LEVEL`. Raises CaptureError as `read_image`."""
    grey = _open(path).read(oiio.FLOAT)[..., :3] @ np.array([0.299, 0.587, 0.114])
    rows = (np.arange(height) + 0.5) * grey.shape[0] / height
    columns = (np.arange(width) + 0.5) * grey.shape[1] / width
    level = GT_LEVEL if grey.max() > GT_LEVEL else 0
    mask = grey[rows.astype(int)][:, columns.astype(int)] > level
    return torch.from_numpy(mask)[..., None]


def resize_image(
    image: UInt8[np.ndarray, "H W C"], width: int, height: int
) -> UInt8[np.ndarray, "h w C"]:
    """Reduce by area: each new pixel is the mean of the rectangle it covers, rounded; of RGBA
    weighted by alpha, so that what is transparent does not bleed."""
    if image.shape[:2] == (height, width):
        return image
    if image.shape[2] == 3:
        return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    weighted = image.astype(np.float32)
    weighted[..., :3] *= weighted[..., 3:] / 255
    weighted = cv2.resize(weighted, (width, height), interpolation=cv2.INTER_AREA)
    weighted[..., :3] *= 255 / np.maximum(weighted[..., 3:], 1e-3)
    return np.rint(weighted).clip(0, 255).astype(np.uint8)


def resize_mask(mask: Bool[np.ndarray, "H W"], width: int, height: int) -> Bool[np.ndarray, "h w"]:
    """Reduce by area: True where at least half of the rectangle is True."""
    area = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    return area >= 0.5


def _light(path: Path, photo: _Photo) -> Float32[np.ndarray, "H W C"]:
    """Values of floating point, not multiplied by alpha; NaN is black, infinity above white."""
    values = photo.read(oiio.FLOAT)
    if not np.isfinite(values).any():
        raise _unreadable(path, "none of its values is finite")
    values = np.nan_to_num(values, nan=0, posinf=1e9, neginf=0)
    if photo.is_multiplied and values.shape[2] == 4:
        values[..., :3] /= np.where(values[..., 3:] > 0, values[..., 3:], 1)
    return values


@cache
def _exposure(folder: Path) -> float:
    """What values of floating point below a folder are multiplied by, a power of two: 1 where at
    most 5% of them are above 1.0, which is white, and not all are dark; else what makes it so."""
    names = [name for name in file_names(folder) if name.lower().endswith(FLOAT_SUFFIXES)]
    samples = [np.zeros(1, np.float32)]
    for name in names[:: max(1, math.ceil(len(names) / EXPOSED_FILES))]:
        with suppress(CaptureError):
            if (photo := _open(folder / name)).is_float:
                step = math.ceil(max(photo.size) / 256)
                samples.append(_light(folder / name, photo)[::step, ::step, :3].ravel())
    values = np.concatenate(samples)
    bright, brightest = np.quantile(values, (0.95, 0.999))
    stops = 0
    if bright > 1.1:  # where photos were resized, white is a little above 1.0
        stops = -math.ceil(math.log2(bright / 1.1))
    elif 0 < brightest < 1 / 16:
        stops = -math.ceil(math.log2(brightest))
    announce(
        f"Photos of floating point in {folder} have one exposure, 2^{stops}: white is "
        f"{2.0**-stops:g}. Of the values of {len(samples) - 1} photos "
        f"{(values * 2.0**stops > 1.01).mean():.2%} are above it and become white."
    )
    return 2.0**stops


def _open(path: Path, camera: tuple[int, int] | None = None) -> _Photo:
    """The photo, not decoded yet. Raises CaptureError."""
    if not path.is_file():
        raise CaptureError(
            f"Image {path} does not exist. Check --data and the images folder, or remove the image "
            "from the reconstruction."
        )
    form, spec, decode = _open_heif(path) if _kind(path) in ("HEIC", "AVIF") else _open_oiio(path)
    x, y, width, height = 0, 0, spec.width, spec.height
    if form == "openexr" and camera != (width, height):  # the display window
        x, y = spec.full_x - spec.x, spec.full_y - spec.y
        width, height = spec.full_width, spec.full_height
    if max(width * height, spec.width * spec.height) > MOST_PIXELS:
        reason = f"it has {width}x{height} pixels, and {MOST_PIXELS} is the most that is decoded"
        raise _unreadable(path, reason)
    turn = spec.get_int_attribute("Orientation", 1)
    is_camera = camera and (width > height) == (camera[0] > camera[1])
    if turn not in range(2, 9) or is_camera or (camera and turn < 5):
        turn = 1

    def read(kind: Any) -> np.ndarray:
        try:
            pixels: Any = decode(kind)
        except Exception as error:  # damage ends in errors of many kinds
            raise _damaged(path, error) from error
        if (x, y, width, height) != (0, 0, spec.width, spec.height):  # black where it has none
            rows = max(0, -y), max(0, y + height - spec.height)
            columns = max(0, -x), max(0, x + width - spec.width)
            pixels = np.pad(pixels, (rows, columns, (0, 0)))[max(0, y) :, max(0, x) :]
            pixels = pixels[:height, :width]
        # EXIF 2.3, tag 0x0112. OpenImageIO 3.0.21's `reorient` has 5 and 7 the wrong way round.
        pixels = pixels.swapaxes(0, 1) if turn >= 5 else pixels
        return pixels[:: -1 if turn in (3, 4, 7, 8) else 1, :: -1 if turn in (2, 3, 6, 7) else 1]

    space = spec.get_string_attribute("oiio:ColorSpace").lower()
    says = space.startswith(("lin", "scene")) or (form == "openexr" and not space)
    says |= "linear" in spec.get_string_attribute("ICCProfile:profile_description").lower()
    is_own = spec.get_int_attribute("oiio:UnassociatedAlpha", 0) or spec.alpha_channel < 0
    return _Photo(
        spec,
        read,
        size=(height, width) if turn >= 5 else (width, height),
        is_float=spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE),
        is_linear=says and form != "png",
        is_multiplied=form in ("openexr", "tiff") and not is_own,
    )


_Opened = tuple[str, Any, Callable[[Any], np.ndarray]]
"""OpenImageIO's name of a format, the header (`ImageSpec`), and what decodes to a type."""


def _open_oiio(path: Path) -> _Opened:
    """The first part of a file that has colours."""
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    try:
        file = None if _kind(path)[:2] in ("a ", "an") else oiio.ImageInput.open(str(path), hints)
    except (TypeError, UnicodeError):
        raise _unreadable(path, "its name is no text in UTF-8", "Rename it") from None
    if file is None:
        raise _damaged(path, oiio.geterror())
    for part in count():
        if not file.seek_subimage(part, 0):
            file.geterror()
            raise _unreadable(path, "it has neither grey nor red, green and blue")
        spec = file.spec()
        if channels := _channels([*spec.channelnames]):
            break
    first, last = min(channels), max(channels)
    if "LAB" in spec.get_string_attribute("tiff:ColorSpace"):
        raise _unreadable(path, "its colours are CIELAB")
    if spec.get_int_attribute("tiff:subfiletype", 0) == 1:
        raise _unreadable(path, "it starts with a preview, as raw photos do", "Develop it to PNG")
    is_inverted = spec.get_int_attribute("tiff:PhotometricInterpretation", 1) == 0

    def decode(kind: Any) -> np.ndarray:
        pixels = file.read_image(part, 0, first, last + 1, kind)
        problem = file.geterror()
        if pixels is None or any("extraneous" not in line for line in problem.splitlines()):
            raise ValueError(problem)
        if channels != [*range(first, last + 1)]:
            pixels = pixels[..., [channel - first for channel in channels]]
        if is_inverted and spec.format.basetype != oiio.UINT8:  # OpenImageIO does it for these
            pixels = (1 if pixels.dtype.kind == "f" else np.iinfo(pixels.dtype).max) - pixels
        return pixels

    return file.format_name(), spec, decode


def _open_heif(path: Path) -> _Opened:
    try:
        if _kind(path) == "HEIC":
            import pillow_heif

            pillow_heif.register_heif_opener()
        image = Image.open(path)
        mode = "RGBA" if image.has_transparency_data else "RGB"
    except ImportError as error:
        cure = "Type `pip install pillow-heif`, convert it"
        raise _unreadable(path, "pillow-heif is not installed", cure) from error
    except Exception as error:
        raise _damaged(path, error) from error
    spec = oiio.ImageSpec(*image.size, len(mode), oiio.UINT8)
    with suppress(Exception):  # damaged tags
        tags = Image.Image.getexif(image)
        tags = {**tags, **tags.get_ifd(ExifTags.IFD.Exif)}
        for name in ("Make", "Model", "Orientation", _LENS, _FOCAL, _FOCAL_35MM):
            if value := tags.get(ExifTags.Base[name.removeprefix("Exif:")]):
                spec.attribute(name, value if isinstance(value, str | int) else float(value))

    def decode(kind: Any) -> np.ndarray:
        pixels = np.asarray(image.convert(mode))
        return pixels / np.float32(255) if kind == oiio.FLOAT else pixels

    return "heif", spec, decode


def _channels(names: list[str]) -> list[int]:
    """Where R, G, B and perhaps A are, in the layer of the shortest name that has them; of grey
    thrice the same; empty where there is neither."""
    short = [re.sub("(red|green|blue|alpha)$", lambda m: m[0][0], name.lower()) for name in names]
    layers = [name[:-1] for name in short if re.search(r"(^|\.)r$", name)]
    for layer in sorted(layers, key=len):
        if {layer + "g", layer + "b"} <= set(short):
            return [short.index(layer + letter) for letter in "rgba" if layer + letter in short]
    last = {name.split(".")[-1] for name in short}
    if (len(names) > 2 and "y" not in short) or last & {"x", "z", "by"}:  # depth, XYZ, YBR
        return []
    grey = short.index("y") if "y" in short else 0
    return [grey, grey, grey, *(i for i, name in enumerate(short) if name == "a")]


def _kind(path: Path) -> str:
    """One of `_KINDS`; empty where it is none."""
    try:
        with path.open("rb") as file:
            begins = file.read(4096)
    except OSError as error:
        raise CaptureError(f"Image {path} cannot be read: {error}. Mend that.") from error
    return next((k for k, magic in _KINDS.items() if re.match(magic, begins, re.S | re.I)), "")


def _damaged(path: Path, problem: object) -> CaptureError:
    detail = " ".join(str(problem).split()) or "no pixels in it"
    what = f"damaged, or of a {'variant' if _kind(path) else 'format'} that is not read ({detail})"
    return _unreadable(path, f"it is {what}", "Copy it again from its source, convert it")


def _unreadable(path: Path, problem: str, cure: str = "Convert it to PNG") -> CaptureError:
    kind, formats = _kind(path), oiio.get_string_attribute("format_list").split(",")
    what = f"it is {kind}, and {problem}" if kind else problem
    if kind[:2] in ("a ", "an"):
        what, cure = f"it is {kind}", "Put a JPEG or PNG in its place"
    elif kind not in ("", "HEIC", "AVIF") and kind.lower().replace(" ", "") not in formats:
        what = f"it is {kind}, which the installed OpenImageIO {oiio.VERSION_STRING} does not know"
        cure = "Type `pip install --no-deps 'OpenImageIO>=3.2'`, convert it"
    return CaptureError(
        f"Image {path} cannot be read: {what}. {cure}, or remove it from the reconstruction (or "
        "from transforms.json)."
    )
