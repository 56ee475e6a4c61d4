"""Photos as they are processed: upright, 8 bit, of a sensible size, each looked at once.

Letters in shapes: H x W pixels.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
import PIL.Image
from jaxtyping import UInt8

from desplat_ns.data.exif import Lens, lens_of
from desplat_ns.data.images import read_image, resize_image
from desplat_ns.errors import CaptureError

JPEG_QUALITY = 95
"""Of what is written: photos are written twice, so each time must cost nothing to be seen."""
SHARPNESS_SIDE = 800
"""Pixels of the longer side at which sharpness is measured, so that photos of all sizes compare."""


@dataclass(frozen=True)
class Photo:
    """One photo of the user's and its copy in the work folder."""

    source: str
    """Path below the sources' folder."""
    name: str
    """Path below OUTPUT/images."""
    copy: str
    """File in the work folder: a number, so that no program trips over spaces or umlauts."""
    width: int = 0
    height: int = 0
    """Pixels of the copy; 0 where there is none."""
    sharpness: float = 0.0
    """Variance of the Laplacian of grey values of 0 to 255."""
    digest: str = ""
    """Of the pixels: equal photos have equal ones."""
    camera: str = ""
    """Make, model, lens and focal length as EXIF gives them; empty where it does not."""
    focal: float = 0.0
    """Focal length in pixels of the copy by EXIF; 0 where it does not say."""
    problem: str = ""
    """Why it cannot be used; empty where it can."""


def numbered(sources: Sequence[str]) -> list[Photo]:
    """A photo for each source; no two share a name: `a.png` beside `a.jpg` is `a_png.jpg`."""
    photos: list[Photo] = []
    taken: set[str] = set()
    for number, source in enumerate(sources, 1):
        path = PurePosixPath(source)
        name = str(path.with_suffix(".jpg"))
        if name.lower() in taken:
            name = str(path.with_name(f"{path.stem}_{path.suffix[1:]}.jpg"))
        taken.add(name.lower())
        photos.append(Photo(source, name, f"{number:05d}.jpg"))
    return photos


def prepare_photos(
    folder: Path,
    sources: Sequence[str],
    copies: Path,
    longest_side: int,
    threads: int,
    done: Callable[[int], None],
) -> list[Photo]:
    """Copy all photos to `copies`, and say of each what was seen.

    What an earlier call copied is not copied again: `copies`/seen.jsonl has a line for each.

    Args:
        folder: of the sources.
        longest_side: in pixels; larger photos are reduced by area.
        done: called with the number of photos that are done.

    Raises:
        OSError: a copy cannot be written.
    """
    copies.mkdir(parents=True, exist_ok=True)
    journal = copies / "seen.jsonl"
    known = {photo.source: photo for photo in _read_seen(journal)}

    def prepared(photo: Photo) -> Photo:
        if photo.source not in known:
            return _prepare(folder, photo, copies, longest_side)
        return known[photo.source]

    photos = []
    with ThreadPoolExecutor(threads) as pool, journal.open("a", encoding="utf8") as file:
        for photo in pool.map(prepared, numbered(sources)):
            if photo.source not in known:
                file.write("\n" + json.dumps(asdict(photo)))  # a line that was cut off ends here
                file.flush()
            photos.append(photo)
            done(len(photos))
    return _without_twins(photos)


def _read_seen(path: Path) -> Iterable[Photo]:
    for line in path.read_text("utf8").splitlines() if path.is_file() else ():
        try:
            yield Photo(**json.loads(line))
        except (ValueError, TypeError):
            continue  # an empty line, or one that a kill cut off


def _prepare(folder: Path, photo: Photo, copies: Path, longest_side: int) -> Photo:
    path = folder / photo.source
    try:
        pixels = np.ascontiguousarray(read_image(path)[..., :3])
        lens = lens_of(path)
    except CaptureError as error:
        return replace(photo, problem=_reason(error))
    scale = min(1.0, longest_side / max(pixels.shape[:2]))
    if scale < 1:
        height, width = (max(1, round(side * scale)) for side in pixels.shape[:2])
        pixels = resize_image(pixels, width, height)
    write_jpeg(copies / photo.copy, pixels)
    height, width = pixels.shape[:2]
    return replace(
        photo,
        width=width,
        height=height,
        sharpness=round(sharpness(pixels), 2),
        digest=hashlib.sha1(pixels.tobytes()).hexdigest(),
        camera=lens.name,
        focal=round(_focal_in_pixels(lens, width, height), 2),
    )


def _reason(error: CaptureError) -> str:
    """`cannot be read: ...` without the path, which is said beside it."""
    _, _, reason = str(error).partition(" cannot be read: ")
    return f"cannot be read: {reason.partition('. Copy it')[0]}" if reason else str(error)


def _focal_in_pixels(lens: Lens, width: int, height: int) -> float:
    """From the focal length on 35 mm film, whose diagonal is 43.27 mm; 0 where it is not known."""
    return lens.focal_35mm / 43.2666 * float(np.hypot(width, height))


def sharpness(pixels: UInt8[np.ndarray, "H W 3"]) -> float:
    """Variance of the Laplacian of a photo's grey values, at `SHARPNESS_SIDE` pixels at most."""
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    scale = SHARPNESS_SIDE / max(grey.shape)
    if scale < 1:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(grey, cv2.CV_64F).var())


def write_jpeg(path: Path, pixels: UInt8[np.ndarray, "H W 3"]) -> None:
    """Write a photo at `JPEG_QUALITY`, with colour at full resolution; never half of it.

    Raises:
        OSError: it cannot be written.
    """
    part = path.with_suffix(".part")
    PIL.Image.fromarray(pixels).save(part, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    part.replace(path)


def _without_twins(photos: Sequence[Photo]) -> list[Photo]:
    """The photos, those with the same pixels as an earlier one marked as not to be used."""
    first: dict[str, str] = {}
    kept = []
    for photo in photos:
        twin = first.setdefault(photo.digest, photo.source) if photo.digest else photo.source
        same = f"the same picture as {twin}" if twin != photo.source else photo.problem
        kept.append(replace(photo, problem=same))
    return kept
