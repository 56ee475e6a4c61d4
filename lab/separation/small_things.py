"""Small things in the way, pasted into one, two or three photos that follow each other.

What really moves is small: 0.5 to 6% of a photo. One capture carries many such things, far from one
another, so that one training tests them all. Held-out photos stay as they are.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
import PIL.Image  # noqa: F401  pycolmap 4.2.1 must not be imported before PIL: PNG writing crashed
import pycolmap
from jaxtyping import Float

from desplat_ns.data.images import read_image, write_image
from lab.separation.small_places import Place, Places

HELD_OUT_EVERY = 8
"""Of the photos in the order of the reconstruction, the first and each so many are held out: what
the `colmap` dataparser does."""

SIZES, COUNTS = (0.005, 0.01, 0.02, 0.06), (1, 2, 3)
"""Shares of a photo's area, and numbers of photos."""

KINDS = ("smooth", "scene colours", "cut", "blurred", "half transparent", "far")
"""Beside `plain`, a figure filled with a crop of another capture: of one colour; filled with a crop
of its own capture; half beyond the photo's border; blurred by motion; at an opacity of 0.5; where
the points of the photo are farthest."""

FAR = 0.5
"""What is far is so much smaller."""

THINGS_PER_PHOTO = 0.65
"""Things of a capture, for each of its training photos."""

BODY, HEAD = (0.36, 0.72, 1.12), (0.22, 0.22, 0.24)
"""Half axes and height of the centre of a figure's two ellipses, in units of about the root of its
area."""

BLUR = 1 / 3
"""Length of a motion blur, in widths of the figure."""

LEAST_CONTRAST = 0.1
"""Mean difference (colours in [0, 1]) from what is covered; other stuff is drawn where it is less.
Not asked of what has the scene's colours."""

TRIES = 10


@dataclass(frozen=True)
class Wish:
    """What a thing is to be like."""

    kind: str
    size: float
    """Share of the photo that it covers."""
    count: int
    """Photos that show it."""


@dataclass(frozen=True)
class Thing:
    """What was pasted."""

    id: int
    kind: str
    size: float
    ground: str
    """`smooth` or `textured`: what it covers."""
    contrast: float
    """Mean difference from what is covered, colours in [0, 1]."""
    boxes: dict[str, tuple[int, int, int, int]]
    """Left, top, right and bottom of its mask, pixels, by the names of its photos."""


def wishes(count: int, rng: np.random.Generator) -> list[Wish]:
    """So many of the 36 combinations: three `plain` for each four others, all kinds in turn."""
    plain = [Wish("plain", size, photos) for size in SIZES for photos in COUNTS]
    ways = [(size, photos) for size in SIZES[1:3] for photos in COUNTS[::2]]
    turns = {kind: rng.permutation(len(ways)) for kind in KINDS}
    others = [
        Wish(KINDS[kind], *ways[turns[KINDS[kind]][turn]])
        for turn in range(len(ways))
        for kind in rng.permutation(len(KINDS))
    ]
    ranked = [(4 * i + 2, plain[n]) for i, n in enumerate(rng.permutation(len(plain)))]
    ranked += [(3 * i + 3, wish) for i, wish in enumerate(others)]
    return [wish for _, wish in sorted(ranked, key=lambda r: r[0])[:count]]


def figure(area: float) -> Float[np.ndarray, "h w"]:
    """Opacity of a standing figure of so many pixels: an ellipse, with a head above it."""
    unit = math.sqrt(area / (math.pi * (math.prod(BODY[:2]) + math.prod(HEAD[:2]))))
    width, height = math.ceil(2.1 * BODY[0] * unit), math.ceil(1.88 * unit)
    y, x = (np.indices((4 * height, 4 * width)) + 0.5) / (4 * unit)
    x = x - x.mean()
    parts = [(x / a) ** 2 + ((y - center) / b) ** 2 < 1 for a, b, center in (BODY, HEAD)]
    inside = np.logical_or(*parts).astype(np.float32)
    return cv2.resize(inside, (width, height), interpolation=cv2.INTER_AREA)


def _stuff(kind: str, shape: tuple[int, int], photos: Sequence[Path], rng: np.random.Generator):
    """Colours in [0, 1] of a box of `shape`: one colour, or a crop of any of the photos."""
    if kind == "smooth":
        return np.broadcast_to(rng.uniform(0.05, 0.95, 3), (*shape, 3))
    photo = read_image(photos[rng.integers(len(photos))])[..., :3]
    scale = max(1.0, shape[0] / photo.shape[0], shape[1] / photo.shape[1])
    photo = cv2.resize(photo, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    top, left = (rng.integers(n - m + 1) for n, m in zip(photo.shape[:2], shape, strict=True))
    return photo[top : top + shape[0], left : left + shape[1]] / 255


def _blurred(layer: Float[np.ndarray, "h w 4"], length: float, angle: float) -> np.ndarray:
    """Smeared along a direction; larger by the blur on all sides."""
    half = math.ceil(length / 2)
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for t in np.linspace(-length / 2, length / 2, 8 * half + 1):
        kernel[round(half + t * math.sin(angle)), round(half + t * math.cos(angle))] += 1
    padded = np.pad(layer, ((half, half), (half, half), (0, 0)))
    return cv2.filter2D(padded, -1, kernel / kernel.sum(), borderType=cv2.BORDER_CONSTANT)


def _layer(wish: Wish, pixels: int, photos: Sequence[Path], angle: float, rng: np.random.Generator):
    """The thing alone: colours times opacity, and opacity."""
    alpha = figure(area_of(wish) * pixels)
    colors = _stuff(wish.kind, (alpha.shape[0], alpha.shape[1]), photos, rng)
    layer = np.concatenate([colors * alpha[..., None], alpha[..., None]], -1).astype(np.float32)
    if wish.kind == "blurred":
        return _blurred(layer, BLUR * alpha.shape[1], angle)
    return layer * (0.5 if wish.kind == "half transparent" else 1.0)


def area_of(wish: Wish) -> float:
    """Share of the photo that the whole figure has, its part beyond the border included."""
    return wish.size * {"cut": 2.0, "far": FAR}.get(wish.kind, 1.0)


def over(photo: Float[np.ndarray, "H W 3"], layer: Float[np.ndarray, "h w 4"], x: int, y: int):
    """The photo with a layer whose centre is at a pixel, and the layer's opacity there."""
    (height, width), (h, w) = photo.shape[:2], layer.shape[:2]
    left, top = x - w // 2, y - h // 2
    rows = slice(max(0, top), min(height, top + h))
    columns = slice(max(0, left), min(width, left + w))
    whole = np.zeros((height, width, 4), np.float32)
    part = layer[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    whole[rows, columns] = part
    return photo * (1 - whole[..., 3:]) + whole[..., :3], whole[..., 3]


class _Canvas:
    """The photos of a capture while things are pasted into them."""

    def __init__(self, images: Path, names: Sequence[str]) -> None:
        self.photos = {name: read_image(images / name)[..., :3] / 255.0 for name in names}
        self.masks = {name: np.zeros(photo.shape[:2], bool) for name, photo in self.photos.items()}
        self.changed: set[str] = set()

    def paste(
        self, wish: Wish, place: Place, photos: Sequence[Path], rng: np.random.Generator
    ) -> tuple[float, dict[str, tuple[int, int, int, int]]]:
        """Contrast and boxes of a thing; `photos` are what it is filled with."""
        pixels = self.masks[place.names[0]].size
        for _ in range(TRIES):
            layer = _layer(wish, pixels, photos, place.angle, rng)
            pasted = {
                name: over(self.photos[name], layer, x, y)
                for name, (x, y) in zip(place.names, place.centers, strict=True)
            }
            full = 0.25 if wish.kind == "half transparent" else 0.5
            shown = {name: alpha > full for name, (_, alpha) in pasted.items()}
            contrast = float(
                np.mean([np.abs(p[0] - self.photos[n])[shown[n]].mean() for n, p in pasted.items()])
            )
            if wish.kind == "scene colours" or contrast >= LEAST_CONTRAST:
                break
        for name, (photo, _) in pasted.items():
            self.photos[name] = photo
            self.masks[name] |= shown[name]
        self.changed |= set(place.names)
        return contrast, {name: _box(mask) for name, mask in shown.items()}


def _box(mask: np.ndarray) -> tuple[int, int, int, int]:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def make(source: Path, stuff: Path, target: Path, seed: int) -> list[Thing]:
    """Write a copy of a capture with small things in some of its training photos.

    Beside photos and reconstruction it has masks/, clean/ (the changed photos as they were) and
    things.json. Of a generated capture the clean photos and the extras are taken.

    Args:
        source: a COLMAP capture, of photos of about the same area.
        stuff: another, with whose photos things are filled.
        target: a folder that does not exist.
    """
    rng = np.random.default_rng(seed)
    (model,) = {path.parent for path in (source / "sparse").rglob("images.*")}
    reconstruction = pycolmap.Reconstruction(model)
    for image in list(reconstruction.images.values()):
        if image.name.startswith("clutter_"):
            reconstruction.deregister_frame(image.frame_id)
    images = source / "images"
    names = [reconstruction.images[i].name for i in sorted(reconstruction.reg_image_ids())]
    train = [name for i, name in enumerate(names) if i % HELD_OUT_EVERY != 0]
    canvas, places = _Canvas(images, train), Places(reconstruction, images, train, rng)
    others = sorted((stuff / "images").iterdir())
    own = [images / name for name in train]
    things: list[Thing] = []
    wanted = [*enumerate(wishes(round(THINGS_PER_PHOTO * len(train)), rng))]
    for number, wish in sorted(wanted, key=lambda w: -w[1].size * w[1].count):  # large ones first
        shape = figure(area_of(wish) * canvas.masks[train[0]].size).shape
        ground = ("textured", "smooth")[number % 2]
        place = places.find(wish.kind, wish.count, (shape[1], shape[0]), ground)
        if place is None:
            print(f"{source.name}: no place is free for {wish}")
            continue
        fill = own if wish.kind == "scene colours" else others
        contrast, boxes = canvas.paste(wish, place, fill, rng)
        things.append(Thing(number, wish.kind, wish.size, place.ground, round(contrast, 3), boxes))
    things.sort(key=lambda thing: thing.id)
    _write(target, images, names, canvas, reconstruction)
    (target / "things.json").write_text(json.dumps([asdict(thing) for thing in things], indent=1))
    return things


def _write(
    target: Path,
    images: Path,
    names: Sequence[str],
    canvas: _Canvas,
    reconstruction: pycolmap.Reconstruction,
) -> None:
    """The files of a capture; what a thing hides is no observation of its photo any more."""
    for folder in ("images", "masks", "clean", "sparse/0"):
        (target / folder).mkdir(parents=True)
    for name in names:
        original = (images / name).resolve()
        if name not in canvas.changed:
            (target / "images" / name).symlink_to(original)
            continue
        (target / "clean" / name).symlink_to(original)
        write_image(target / "images" / name, canvas.photos[name])
        write_image(target / "masks" / Path(name).with_suffix(".png"), canvas.masks[name])
    for image in reconstruction.images.values():
        if image.name in canvas.changed:
            for index in list(_hidden(image, canvas.masks[image.name])):
                reconstruction.delete_observation(image.image_id, index)
    reconstruction.write_binary(str(target / "sparse" / "0"))


def _hidden(image: pycolmap.Image, mask: np.ndarray) -> Iterator[int]:
    """Numbers of the image's observations that lie in the mask."""
    for index, point in enumerate(image.points2D):
        x, y = point.xy.astype(int)
        if point.has_point3D() and mask[min(y, mask.shape[0] - 1), min(x, mask.shape[1] - 1)]:
            yield index
