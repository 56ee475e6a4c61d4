"""A large capture within minutes: hundreds of photos, hundreds of thousands of points.

    python -m lab.synthetic.many_photos FOLDER --photos 1000 --width 1600 --height 1200

Photos are painted: a square in its colour for each point in sight, far ones first, and something in
the way. Cameras stand around a ball on a plain. What matters is how much there is of everything.
Letters in shapes: N points.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from desplat_ns.data.images import write_image
from lab.synthetic.cameras import PinholeCamera, arc
from lab.synthetic.colmap_export import RegisteredPhoto, write_reconstruction

PAINTED_WIDTH = 1000
"""Pixels, at most: larger photos are enlarged."""

BALL = np.array([[0.0], [0.3], [0.95]])
"""Where the cameras look; its radius is 0.9 metres."""

RADIUS, PLAIN = 0.9, 4.0


@dataclass(frozen=True)
class ManyPhotos:
    """How much there is of everything."""

    photos: int = 1000
    width: int = 1600
    height: int = 1200
    points: int = 300_000
    observations: int = 5
    """Of each point, on average."""
    seed: int = 0


def write_many_photos(spec: ManyPhotos, folder: Path) -> None:
    """Write `images/photo_NNNN.jpg` and `sparse/0`; the same spec gives the same capture."""
    rng = np.random.default_rng(spec.seed)
    xyz, normals = _points(spec.points, rng)
    rgb = _colors(xyz)
    azimuths = np.linspace(0, 2 * np.pi, spec.photos, endpoint=False)
    small = min(1.0, PAINTED_WIDTH / spec.width)
    cameras = arc(azimuths, (spec.width, spec.height), rng)
    photos = []
    for number, camera in enumerate(cameras):
        painted = camera.with_size(round(small * spec.width), round(small * spec.height))
        shown = _in_sight(painted, xyz, normals)
        image = _paint(painted, xyz[:, shown], rgb[:, shown])
        _put_in_the_way(image, rng)
        image = cv2.resize(image, (spec.width, spec.height), interpolation=cv2.INTER_LINEAR)
        name = f"photo_{number:04d}.jpg"
        write_image(folder / "images" / name, image)
        wanted = spec.observations * spec.points // spec.photos
        indices = np.flatnonzero(shown)
        indices = np.sort(rng.permutation(indices)[:wanted])
        pixels, _ = camera.project(xyz[:, indices])
        photos.append(RegisteredPhoto(name, camera, indices, pixels))
    write_reconstruction(folder / "sparse" / "0", photos, xyz, rgb)


def _points(
    count: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "3 N"], Float[np.ndarray, "3 N"]]:
    """Places and normals: half of them on the ball, half on the plain."""
    ball = rng.normal(size=(3, count // 2))
    ball /= np.linalg.norm(ball, axis=0)
    plain = rng.uniform(-PLAIN, PLAIN, (3, count - count // 2))
    plain[2] = 0
    up = np.zeros_like(plain)
    up[2] = 1
    return np.hstack([BALL + RADIUS * ball, plain]), np.hstack([ball, up])


def _colors(xyz: Float[np.ndarray, "3 N"]) -> UInt8[np.ndarray, "3 N"]:
    """Waves of several lengths, from 3 metres to a decimetre."""
    waves = [np.sin(f * xyz[[0, 1, 2]] + 2 * xyz[[1, 2, 0]]) for f in (2, 9, 31, 60)]
    return np.clip(128 + 28 * np.sum(waves, axis=0), 0, 255).astype(np.uint8)


def _in_sight(
    camera: PinholeCamera, xyz: Float[np.ndarray, "3 N"], normals: Float[np.ndarray, "3 N"]
) -> Bool[np.ndarray, " N"]:
    """What faces the camera, lies in the picture, and not behind the ball."""
    pixels, depth = camera.project(xyz)
    toward = camera.position[:, None] - xyz
    inside = (pixels >= 1).all(0) & (pixels[0] < camera.width - 2) & (pixels[1] < camera.height - 2)
    distance = np.linalg.norm(toward, axis=0)
    along = ((BALL - xyz) * toward).sum(0) / distance
    aside = np.linalg.norm(BALL - xyz - along * toward / distance, axis=0)
    hidden = (along > 0.01) & (aside < RADIUS * 0.999) & (xyz[2] == 0)
    return (depth > 0.1) & inside & ((normals * toward).sum(0) > 0) & ~hidden


def _paint(
    camera: PinholeCamera, xyz: Float[np.ndarray, "3 N"], rgb: UInt8[np.ndarray, "3 N"]
) -> UInt8[np.ndarray, "H W 3"]:
    image = np.full((camera.height, camera.width, 3), (150, 180, 220), np.uint8)
    pixels, depth = camera.project(xyz)
    order = np.argsort(-depth)
    x, y = pixels[:, order].astype(int)
    for right in (-1, 0, 1):
        for down in (-1, 0, 1):
            image[y + down, x + right] = rgb.T[order]
    return image


def _put_in_the_way(image: UInt8[np.ndarray, "H W 3"], rng: np.random.Generator) -> None:
    """A plain box, a fifth of the picture's sides, somewhere."""
    height, width = image.shape[:2]
    x, y = (rng.uniform(0, 0.8, 2) * (width, height)).astype(int)
    image[y : y + height // 5, x : x + width // 5] = rng.integers(0, 256, 3)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    for field in ("photos", "width", "height", "points"):
        parser.add_argument(f"--{field}", type=int, default=getattr(ManyPhotos, field))
    options = vars(parser.parse_args())
    write_many_photos(
        ManyPhotos(**{k: v for k, v in options.items() if k != "folder"}), options["folder"]
    )
