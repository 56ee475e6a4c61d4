"""A capture written by hand: COLMAP's text files line by line, photos of noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

POINTS = ("1 0.5 -1 4 10 20 30 0.25 1 0 2 0", "2 1 2 3 200 100 50 0.5 1 1")


def write_model(
    folder: Path,
    names: Sequence[str],
    cameras: Sequence[str] = ("1 PINHOLE 8 6 10 11 4 3",),
    points: Sequence[str] = POINTS,
) -> Path:
    """COLMAP's text format: photo i stands at x = i, looks along +z, has camera min(i, last)."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n")
    lines = []
    for i, name in enumerate(names):
        camera_id = min(i + 1, len(cameras))
        observed = "1 1 1 2 2 2" if i == 0 else "1 1 1"
        lines += [f"{i + 1} 1 0 0 0 {-i} 0 0 {camera_id} {name}", observed]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "points3D.txt").write_text("\n".join(points) + "\n")
    return folder


def write_photo(
    path: Path, width: int = 8, height: int = 6, seed: int = 0, **options
) -> np.ndarray:
    """A photo of noise; returns its pixels."""
    pixels = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, **options)
    return pixels


@pytest.fixture
def model_writer() -> Callable[..., Path]:
    return write_model


@pytest.fixture
def photo_writer() -> Callable[..., np.ndarray]:
    return write_photo


@pytest.fixture
def capture(tmp_path: Path) -> Callable[..., Path]:
    """`capture(names, **of_write_model)`: a folder with `images` and `sparse/0`."""

    def make(names: Sequence[str] = ("a.png", "b.png", "c.png"), **options) -> Path:
        data = tmp_path / "capture"
        write_model(data / "sparse" / "0", names, **options)
        for seed, name in enumerate(names):
            write_photo(data / "images" / name, seed=seed)
        return data

    return make
