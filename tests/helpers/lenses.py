"""Captures whose lenses bend."""

import shutil
from pathlib import Path

import pycolmap

BARREL = "OPENCV 0.2 0 0 0"
"""COLMAP's model and its distortion: k1, k2, p1, p2."""


def distort(data: Path, lens: str = BARREL) -> None:
    """Give every camera of a capture of pinholes a lens, written as `BARREL` is."""
    folder = data / "sparse" / "0"
    model = pycolmap.Reconstruction(folder)
    shutil.rmtree(folder)
    folder.mkdir()
    model.write_text(folder)
    file, (name, numbers) = folder / "cameras.txt", lens.split(" ", 1)
    lines = file.read_text().splitlines()
    cameras = [line.replace("PINHOLE", name) + f" {numbers}" for line in lines if "#" not in line]
    file.write_text("\n".join(cameras) + "\n")
