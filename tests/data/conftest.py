"""A Photo Tourism scene of a few photos: dense/images, dense/sparse, scene.tsv."""

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from tests.helpers.files import write_split

CAMERAS = (
    "1 PINHOLE 8 6 10 11 4 3",
    "2 PINHOLE 6 8 10 11 3 4",
    "3 PINHOLE 12 4 10 11 6 2",
    "4 PINHOLE 8 6 10 11 4 3",
)
SIZES = ((8, 6), (6, 8), (12, 4), (8, 6))
SPLIT = {"a.jpg": "train", "b.jpg": "train", "c.jpg": "test"}


@pytest.fixture
def scene(
    tmp_path: Path, model_writer: Callable[..., Path], photo_writer: Callable[..., object]
) -> Callable[..., Path]:
    """`scene(split, images, sparse)`: photos a to d of three sizes; d is in no split file."""

    def make(
        split: Mapping[str, str] | None = SPLIT,
        images: str = "dense/images",
        sparse: str = "dense/sparse",
    ) -> Path:
        data = tmp_path / "scene"
        names = ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]
        model_writer(data / sparse, names, cameras=CAMERAS)
        for seed, (name, size) in enumerate(zip(names, SIZES, strict=True)):
            photo_writer(data / images / name, *size, seed=seed)
        if split is not None:
            write_split(data / "scene.tsv", split)
        return data

    return make
