"""A capture written by hand: COLMAP's text files line by line, photos of noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest


@pytest.fixture
def capture(
    tmp_path: Path, model_writer: Callable[..., Path], photo_writer: Callable[..., object]
) -> Callable[..., Path]:
    """`capture(names, **of_write_model)`: a folder with `images` and `sparse/0`."""

    def make(names: Sequence[str] = ("a.png", "b.png", "c.png"), **options) -> Path:
        data = tmp_path / "capture"
        model_writer(data / "sparse" / "0", names, **options)
        for seed, name in enumerate(names):
            photo_writer(data / "images" / name, seed=seed)
        return data

    return make
