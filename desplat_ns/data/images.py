"""Photos in, pictures out: upright, 8 bit, RGB or RGBA; and what files say of their lens.

Read by OpenImageIO, whose wheel has no HEIC, in which iPhones keep photos: those are read by
pillow-heif, an extra. EXIF is read, and pictures are written, by Pillow.

Letters in shapes: H x W pixels, C channels.
"""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import OpenImageIO as oiio
from jaxtyping import Bool, Float, UInt8
from PIL import ExifTags, Image

from desplat_ns.errors import CaptureError, DeSplatError

Array = np.ndarray

# OpenImageIO 3.0.21's `reorient` has 5 and 7 the wrong way round, hence our own table (EXIF 2.3,
# tag 0x0112).
_UPRIGHT: dict[int, Callable[[Array], Array]] = {
    1: lambda image: image,
    2: lambda image: image[:, ::-1],
    3: lambda image: image[::-1, ::-1],
    4: lambda image: image[::-1],
    5: lambda image: image.swapaxes(0, 1),
    6: lambda image: np.rot90(image, -1),
    7: lambda image: image.swapaxes(0, 1)[::-1, ::-1],
    8: lambda image: np.rot90(image, 1),
}

_HEIC_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"mif1", b"msf1"}
"""Of ISO 23008-12, at the beginning of a file, whatever it is called."""

MOST_PIXELS = 1 << 28
"""Of a photo, 16,384 x 16,384; one whose header says more is not decoded."""


class Lens(NamedTuple):
    """What a photo was taken with, as its file gives it: often absent, sometimes wrong."""

    name: str = ""
    """Make, model, lens and focal length in millimetres; empty where the file says nothing."""
    focal_35mm: float = 0.0
    """Millimetres, as on 35 mm film; 0 where the file does not say."""


def read_image(path: Path, camera: tuple[int, int] | None = None) -> UInt8[np.ndarray, "H W C"]:
    """The photo, RGB (C = 3) or RGBA (C = 4).

    Without a camera it is turned as EXIF says. For a camera, given by width and height, pixels come
    as they are stored, as COLMAP and nerfstudio read them; they are turned only where EXIF names a
    quarter turn without which they do not have the camera's shape.

    Grey becomes RGB; 16-bit and float samples are rounded to 8 bits; files that say that they are
    linear (EXR, HDR) get the sRGB curve, all other values stay as they are. Alpha is not multiplied
    into the colours.

    Raises:
        CaptureError: the file is missing, is not an image, has more than `MOST_PIXELS` or no
            finite values, or ends too early.
    """
    if _is_heic(path):
        try:
            return np.asarray(_open_heic(path).to_pillow().convert("RGB"))
        except (OSError, ValueError, RuntimeError) as error:
            raise _unreadable(path, str(error)) from error
    file = _open(path)
    spec = file.spec()
    picked = _pick_channels(list(spec.channelnames), path)
    kind = oiio.FLOAT if _is_float(spec) else oiio.UINT8
    pixels = file.read_image(0, 0, 0, max(picked) + 1, kind)
    problem = file.geterror()
    file.close()
    if pixels is None or problem:
        raise _unreadable(path, problem)
    pixels = np.asarray(pixels)[..., picked]
    if _is_float(spec):
        if not np.isfinite(pixels).any():
            raise _unreadable(path, "none of its values is finite")
        pixels = _to_uint8(_encode_srgb(pixels) if _is_linear(spec) else pixels)
    upright = _UPRIGHT.get(_orientation(spec, camera), _UPRIGHT[1])
    return np.ascontiguousarray(upright(pixels))


def image_size(path: Path, camera: tuple[int, int] | None = None) -> tuple[int, int]:
    """(width, height) in pixels, turned as `read_image` does it; reads the header only.

    Raises:
        CaptureError: the file is missing, is not an image, or has more than `MOST_PIXELS`.
    """
    if _is_heic(path):
        width, height = _open_heic(path).size
        return width, height
    file = _open(path)
    spec = file.spec()
    file.close()
    turned = _orientation(spec, camera) >= 5
    return (spec.height, spec.width) if turned else (spec.width, spec.height)


def lens_of(path: Path) -> Lens:
    """What the file says about camera and lens; nothing where it is missing or is no photo."""
    tags = Image.Exif()
    try:
        if _is_heic(path):
            tags.load(_open_heic(path).info.get("exif") or b"")
        else:
            with Image.open(path) as image:
                tags = image.getexif()
        inner = tags.get_ifd(ExifTags.IFD.Exif)
        names = [tags.get(ExifTags.Base.Make), tags.get(ExifTags.Base.Model)]
        names += [inner.get(ExifTags.Base.LensModel), inner.get(ExifTags.Base.FocalLength)]
        focal = float(inner.get(ExifTags.Base.FocalLengthIn35mmFilm) or 0)
    except Exception:  # damaged tags end in errors of many kinds
        return Lens()
    name = " ".join(str(value).strip("\0 ") for value in names if value)
    return Lens(name, focal if np.isfinite(focal) and focal > 0 else 0.0)


def read_mask(path: Path, camera: tuple[int, int] | None = None) -> Bool[np.ndarray, "H W"]:
    """Where the mask is neither black (where no value is 0, the darkest one is) nor transparent,
    turned as `read_image` does it. Of a mask that is black all over alpha alone counts.

    Raises:
        CaptureError: as `read_image`.
    """
    image = read_image(path, camera)
    colors = _above_black(image[..., :3].max(axis=-1))
    if image.shape[2] == 3:
        return colors
    opaque = _above_black(image[..., 3])
    return colors & opaque if colors.any() else opaque & ~opaque.all()


def _above_black(values: Array) -> Bool[np.ndarray, "H W"]:
    black = int(values.min())
    return values > (black if 2 * black < values.max() else 0)


def resize_image(
    image: UInt8[np.ndarray, "H W C"], width: int, height: int
) -> UInt8[np.ndarray, "h w C"]:
    """Reduce by area: each new pixel is the mean of the rectangle it covers, rounded.

    RGBA is averaged with colours weighted by alpha, so that what is transparent does not bleed.
    """
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


def write_image(
    path: Path,
    image: UInt8[np.ndarray, "H W *C"] | Bool[np.ndarray, "H W *C"] | Float[np.ndarray, "H W *C"],
) -> None:
    """Write a picture in the format that the file name asks for; makes missing folders.

    Booleans become 0 and 255; floats in [0, 1] are rounded to 8 bits.

    Raises:
        DeSplatError: it cannot be written there, or nothing knows the format.
    """
    pixels = image if image.dtype == np.uint8 else _to_uint8(image.astype(np.float32))
    try:
        kind, content = Image.registered_extensions()[path.suffix.lower()], BytesIO()
        single = pixels.ndim == 3 and pixels.shape[2] == 1
        Image.fromarray(pixels[..., 0] if single else pixels).save(content, kind, quality=98)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.getvalue())  # a disk that is full is noticed here
    except (OSError, LookupError, ValueError) as error:
        raise DeSplatError(
            f"Picture {path} cannot be written: {error}. Needed: a folder that may be written, "
            "free space, and a file name that ends in a known format such as .png."
        ) from error


def _open(path: Path) -> oiio.ImageInput:
    if not path.is_file():
        raise CaptureError(
            f"Image {path} does not exist. Check --data and the images folder, or remove the image "
            "from the reconstruction."
        )
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), hints)
    if file is None:
        raise _unreadable(path, oiio.geterror())
    _check_pixels(path, file.spec().width, file.spec().height)
    return file


def _is_heic(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        begins = file.read(12)
    return begins[4:8] == b"ftyp" and begins[8:12] in _HEIC_BRANDS


def _open_heic(path: Path) -> Any:
    """The upright photo, not decoded yet."""
    try:
        import pillow_heif
    except ImportError as error:
        raise CaptureError(
            f"Image {path} is HEIC, as iPhones write it. To read it: pip install pillow-heif. Or "
            "convert the photos to JPEG."
        ) from error
    try:
        photo = pillow_heif.open_heif(path)
    except (OSError, ValueError, RuntimeError) as error:
        raise _unreadable(path, str(error)) from error
    _check_pixels(path, *photo.size)
    return photo


def _check_pixels(path: Path, width: int, height: int) -> None:
    if width * height > MOST_PIXELS:
        reason = f"it has {width}x{height} pixels, and {MOST_PIXELS} is the most that is decoded"
        raise _unreadable(path, reason)


def _unreadable(path: Path, problem: str) -> CaptureError:
    reason = problem.strip().splitlines()[0] if problem.strip() else "no pixels in it"
    return CaptureError(
        f"Image {path} cannot be read: {reason}. Copy it again from its source, or remove it from "
        "the reconstruction (or from transforms.json)."
    )


def _orientation(spec: oiio.ImageSpec, camera: tuple[int, int] | None) -> int:
    orientation = int(spec.getattribute("Orientation") or 1)
    is_camera = camera and (spec.width > spec.height) == (camera[0] > camera[1])
    return 1 if is_camera or (camera and orientation < 5) else orientation


def _is_float(spec: oiio.ImageSpec) -> bool:
    return spec.format.basetype in (oiio.FLOAT, oiio.HALF)


def _is_linear(spec: oiio.ImageSpec) -> bool:
    return str(spec.getattribute("oiio:ColorSpace") or "").lower().startswith(("lin", "scene"))


def _pick_channels(names: list[str], path: Path) -> list[int]:
    """RGB(A) from grey, grey + alpha, RGB, RGBA, or files that hold more than that."""
    upper = [name.upper() for name in names]
    if {"R", "G", "B"} <= set(upper):
        picked = [upper.index(letter) for letter in "RGB"]
    elif len(names) <= 2:
        picked = [0, 0, 0]
    else:
        raise CaptureError(
            f"Image {path} has the channels {', '.join(names[:8])}; grey, RGB or RGBA is needed. "
            "Convert it, for example to PNG."
        )
    return [*picked, upper.index("A")] if "A" in upper else picked


def _encode_srgb(linear: Array) -> Array:
    """Linear light to sRGB (IEC 61966-2-1); alpha stays linear."""
    values = linear.clip(0.0, 1.0)
    colors = values[..., :3]
    curve = 1.055 * np.maximum(colors, 0.0031308) ** (1 / 2.4) - 0.055
    values[..., :3] = np.where(colors <= 0.0031308, 12.92 * colors, curve)
    return values


def _to_uint8(values: Array) -> Array:
    return np.rint(np.nan_to_num(values).clip(0.0, 1.0) * 255.0).astype(np.uint8)
