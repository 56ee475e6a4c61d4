"""Masks for photos: which belongs to which, and at what price that is found out."""

from pathlib import Path

import numpy as np
import pytest

from desplat_ns.data.images import write_image
from desplat_ns.data.photo_files import photo_names
from desplat_ns.process import masks
from desplat_ns.process.photos import Photo


def photo(name: str) -> Photo:
    return Photo(name, name, name, width=8, height=6)


def test_the_folder_of_masks_is_listed_once_however_many_photos_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    photos = [photo(f"{i}.jpg") for i in range(5)]
    for i in range(5):
        write_image(tmp_path / "masks" / f"{i}.png", np.full((6, 8), i % 2 == 0))
    listed = []

    def counted(folder: Path) -> list[str]:
        listed.append(folder)
        return photo_names(folder)

    monkeypatch.setattr(masks, "photo_names", counted)
    assert masks.prepare_masks(tmp_path / "masks", photos, tmp_path / "copies") == 5
    assert listed == [tmp_path / "masks"]
