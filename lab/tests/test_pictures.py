"""What is written reads back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from desplat_ns.data.images import read_image
from lab.pictures import write_image


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_what_is_written_reads_back(tmp_path: Path, channels: int):
    image = np.random.default_rng(0).integers(0, 256, (4, 5, channels), dtype=np.uint8)
    path = tmp_path / "new" / "picture.png"
    for written in (image, image / 255):
        write_image(path, written)
        expected = np.repeat(image, 3, -1) if channels == 1 else image
        np.testing.assert_array_equal(read_image(path), expected)
