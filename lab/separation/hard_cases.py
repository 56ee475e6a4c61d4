"""Captures with one kind of difficult occluder each, pasted over the clean photos of a scene.

A case differs from its scene in the `clutter_` photos and in their masks, nothing else.
"""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import PIL.Image  # noqa: F401  pycolmap 4.2.1 must not be imported before PIL: PNG writing crashed
import pycolmap
from jaxtyping import Bool, UInt8

from desplat_ns.data.images import read_image
from lab.pictures import write_image

Photo = UInt8[np.ndarray, "H W 3"]
Mask = Bool[np.ndarray, "H W"]

RECURRING_SHARE = 5
"""The recurring occluder stands in one of so many views that follow each other."""

RECURRING_SIZE = 0.25
"""Its half height, in units of its distance from the camera."""


def _blob(photo: Photo, share: float, rng: np.random.Generator) -> Mask:
    """An ellipse over about `share` of the image, anywhere inside it."""
    height, width = photo.shape[:2]
    ratio = rng.uniform(0.7, 1.4)
    a, b = (np.sqrt(share * height * width / np.pi * r) for r in (ratio, 1 / ratio))
    a, b = min(a, 0.49 * width), min(b, 0.49 * height)
    center = rng.uniform(0.5 * a, width - 0.5 * a), rng.uniform(0.5 * b, height - 0.5 * b)
    mask = np.zeros((height, width), np.uint8)
    angle = rng.uniform(0, 180)
    cv2.ellipse(mask, (center, (2 * a, 2 * b), angle), (1.0,), -1)
    return mask > 0


def _painted(mask: Mask, low: float, high: float, rng: np.random.Generator) -> Photo:
    """Grained colours between `low` and `high` (of 255), shaded from side to side."""
    color = rng.uniform(low, high, 3)
    shade = np.linspace(-0.04, 0.04, mask.shape[1])[None, :, None] * 255
    grain = rng.normal(0, 2, (*mask.shape, 3))
    return np.clip(color + shade + grain, 0, 255).astype(np.uint8)


def _striped(mask: Mask, rng: np.random.Generator) -> Photo:
    """Stripes of two colours, an eighth of the image's width wide."""
    colors = rng.uniform(0, 255, (2, 3))
    band = np.arange(mask.shape[1]) // max(1, mask.shape[1] // 8) % 2
    return np.broadcast_to(colors[band][None], (*mask.shape, 3)).astype(np.uint8)


Case = Callable[[Photo, np.random.Generator], tuple[Mask, Photo]]


def white(photo: Photo, rng: np.random.Generator) -> tuple[Mask, Photo]:
    """A near-white thing over 12% of the view."""
    mask = _blob(photo, 0.12, rng)
    return mask, _painted(mask, 240, 250, rng)


def black(photo: Photo, rng: np.random.Generator) -> tuple[Mask, Photo]:
    """A near-black thing over 12% of the view."""
    mask = _blob(photo, 0.12, rng)
    return mask, _painted(mask, 5, 15, rng)


def large(photo: Photo, rng: np.random.Generator) -> tuple[Mask, Photo]:
    """Something striped over 40% of the view."""
    mask = _blob(photo, 0.45, rng)  # a part of it lies beyond the border
    return mask, _striped(mask, rng)


def small(photo: Photo, rng: np.random.Generator) -> tuple[Mask, Photo]:
    """Thirty things of 0.3% of the view each, of any colour."""
    mask, colors = np.zeros(photo.shape[:2], bool), photo.copy()
    for _ in range(30):
        blob = _blob(photo, 0.003, rng)
        colors[blob] = _painted(blob, 0, 255, rng)[blob]
        mask |= blob
    return mask, colors


CASES: dict[str, Case] = {"white": white, "black": black, "large": large, "small": small}
RECURRING = "recurring"


def make_case(name: str, scene: Path, folder: Path) -> None:
    """Write the capture of one case into `folder`.

    Args:
        name: of `CASES`, or `RECURRING`: the same thing at the same place in a fifth of the views.
        scene: a capture of `clean_`, `clutter_` and `extra_` photos in images/, with sparse/.
    """
    (folder / "images").mkdir(parents=True)
    (folder / "masks").mkdir()
    (folder / "sparse").symlink_to(scene / "sparse")
    cameras = _projections(scene) if name == RECURRING else {}
    rng = np.random.default_rng(sorted((*CASES, RECURRING)).index(name))
    clutter = sorted((scene / "images").glob("clutter_*"))
    for index, path in enumerate(clutter):
        clean = scene / "images" / path.name.replace("clutter", "clean")
        photo = read_image(clean)
        if name != RECURRING:
            mask, colors = CASES[name](photo, rng)
        elif index < len(clutter) / RECURRING_SHARE:
            mask, colors = _standing(photo, cameras[clean.name])
        else:
            mask, colors = np.zeros(photo.shape[:2], bool), photo
        write_image(folder / "images" / path.name, np.where(mask[..., None], colors, photo))
        gray = np.where(mask, 255, 0).astype(np.uint8)[..., None]
        write_image(folder / "masks" / path.with_suffix(".png").name, gray)
    for path in (scene / "images").iterdir():
        if not path.name.startswith("clutter"):
            (folder / "images" / path.name).symlink_to(path)


def _projections(scene: Path) -> dict[str, tuple[float, float, float]]:
    """For each photo x, y and the half height in pixels of a thing before the scene's centre."""
    (model,) = {path.parent for path in (scene / "sparse").rglob("images.*")}
    reconstruction = pycolmap.Reconstruction(model)
    center = np.median([point.xyz for point in reconstruction.points3D.values()], axis=0)
    places = {}
    for image in reconstruction.images.values():
        x, y, z = image.cam_from_world() * center
        camera = reconstruction.cameras[image.camera_id]
        u, v = camera.params[-2:] + camera.params[:2] * (x / z, y / z)  # PINHOLE
        places[image.name] = (u, v, RECURRING_SIZE * camera.params[0])
    return places


def _standing(photo: Photo, place: tuple[float, float, float]) -> tuple[Mask, Photo]:
    """A red and white post; the same on every photo."""
    u, v, size = place
    rows, columns = np.indices(photo.shape[:2])
    mask = (np.abs(columns - u) < 0.5 * size) & (np.abs(rows - v) < size)
    band = ((rows - v) // (size / 3)).astype(int) % 2
    colors = np.where(band[..., None] == 0, (200, 30, 40), (235, 230, 225)).astype(np.uint8)
    return mask, colors
