"""Real photos as users have them: two places in one folder, 16 bits, EXIF, digital zoom."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import PIL.Image
import pycolmap
import pytest

from desplat_ns.commands.process import run
from desplat_ns.process.request import Request
from lab.process import compare

pytestmark = [pytest.mark.slow, pytest.mark.real_data]

MODEL = Path("sparse", "0")
CLOSE = 0.01
"""Of the longest distance between cameras: how far a centre may be from the known one."""
ZOOM = 1.4
MAKER, MODEL_TAG, EXIF, FOCAL_35MM = 271, 272, 0x8769, 0xA405


def photos_of(capture: Path, first: int, last: int) -> list[Path]:
    return sorted((capture / "images").iterdir())[first:last]


def write_16_bit(photo: Path, target: Path) -> None:
    pixels = np.asarray(PIL.Image.open(photo)).astype(np.uint16) * 257
    file = oiio.ImageOutput.create(str(target))
    assert file is not None
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.UINT16)
    assert file.open(str(target), spec) and file.write_image(pixels) and file.close()


def test_of_two_places_the_one_with_more_photos_is_taken_and_the_other_named(
    data_folder: Callable[[str], Path], tmp_path: Path
):
    """Some are PNG and TIFF with 16 bits, which are read as any other."""
    fox, tree = data_folder("fox"), data_folder("monstree")
    (tmp_path / "photos").mkdir()
    for number, photo in enumerate(photos_of(fox, 0, 12)):
        if number % 3:
            write_16_bit(photo, tmp_path / "photos" / f"{photo.stem}.{('png', 'tif')[number % 2]}")
        else:
            shutil.copy(photo, tmp_path / "photos")
    others = photos_of(tree, 5, 15)
    for photo in others:
        shutil.copy(photo, tmp_path / "photos")
    out = tmp_path / "out"
    run(Request(tmp_path / "photos", out, effort="plain", threads=1))
    found = json.loads((out / "process.json").read_text("utf8"))["findings"]
    assert (found["photos"], found["of"], found["others"]) == (12, 22, [10])
    assert [photo["source"] for photo in found["left_out"]] == [photo.name for photo in others]
    assert all("another model of 10" in photo["reason"] for photo in found["left_out"])
    written = {path.name for path in (out / "images").iterdir()}
    assert written == {photo.name for photo in photos_of(fox, 0, 12)}
    assert compare(out, fox / MODEL).largest < CLOSE


def test_exif_gives_the_focal_length_to_start_from_and_tells_digital_zoom(
    data_folder: Callable[[str], Path], tmp_path: Path
):
    """Every other photo is the middle of what it was, at its size, as phones zoom."""
    fox = data_folder("fox")
    (known,) = pycolmap.Reconstruction(fox / MODEL).cameras.values()
    diagonal = float(np.hypot(known.width, known.height))
    wide = known.mean_focal_length() * 43.2666 / diagonal  # 35 mm film is 43.27 mm across
    (tmp_path / "photos").mkdir()
    for number, path in enumerate(photos_of(fox, 0, 12)):
        photo, zoom = PIL.Image.open(path), ZOOM if number % 2 else 1.0
        tags = PIL.Image.Exif()
        tags[MAKER], tags[MODEL_TAG] = "Maker", "Phone"
        tags.get_ifd(EXIF)[FOCAL_35MM] = round(zoom * wide)
        width, height = (side / zoom / 2 for side in photo.size)
        x, y = (side / 2 for side in photo.size)
        middle = (x - width, y - height, x + width, y + height)
        photo = photo.resize(photo.size, PIL.Image.Resampling.LANCZOS, box=middle)
        photo.save(tmp_path / "photos" / path.name, quality=95, exif=tags)
    out = tmp_path / "out"
    run(Request(tmp_path / "photos", out, effort="plain", threads=1, keep_work=True))
    with pycolmap.Database.open(out / "work" / "plain" / "database.db") as database:
        started = sorted(database.read_all_cameras(), key=lambda camera: camera.params[0])
    for camera, zoom in zip(started, (1.0, ZOOM), strict=True):
        assert camera.has_prior_focal_length
        focal = round(zoom * wide) / 43.2666 * diagonal
        assert camera.mean_focal_length() == pytest.approx(focal, abs=0.01)
    lengths = sorted(
        c.mean_focal_length() for c in pycolmap.Reconstruction(out / MODEL).cameras.values()
    )
    wanted = [known.mean_focal_length(), ZOOM * known.mean_focal_length()]
    assert lengths == pytest.approx(wanted, rel=0.02)
    fit = compare(out, fox / MODEL)
    assert fit.num_known - len(fit.missing) == 12 and fit.largest < CLOSE
