"""Copies of photos of every kind, what is known of them, and their masks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from desplat_ns.process.photos import Photo, prepare_masks, prepare_photos
from tests.helpers.yard import (
    EDGE,
    Features,
    copied,
    features_of,
    places_of,
    silent,
    write_mask_of_the_mark,
)

EXIF, FOCAL_35MM = 0x8769, 0xA405
FILM = 36.0, 24.0
"""Millimetres of a picture on 35 mm film, which the focal length of EXIF is for."""
ROUNDED = 1.0
"""Pixels: pycolmap takes the mask's value at the pixel nearest to a feature."""


def prepared(folder: Path, *names: str, longest_side: int = 1600) -> list[Photo]:
    """Photos of `folder` with copies in `folder`/copies."""
    return prepare_photos(folder, names, folder / "copies", longest_side, 2, silent)


@pytest.mark.parametrize("size", [(300, 200), (320, 240), (150, 200)])
@pytest.mark.parametrize("longest_side", [1600, 100])
def test_a_focal_length_by_exif_sees_the_same_across_as_on_film(
    size: tuple[int, int], longest_side: int, tmp_path: Path
):
    """From corner to corner, whatever the shape of the photo and however it is reduced."""
    tags = PIL.Image.Exif()
    tags.get_ifd(EXIF)[FOCAL_35MM] = 28
    PIL.Image.effect_noise(size, 50).save(tmp_path / "a.jpg", exif=tags)
    PIL.Image.effect_noise(size, 50).save(tmp_path / "b.jpg")
    photo, without = prepared(tmp_path, "a.jpg", "b.jpg", longest_side=longest_side)
    across = np.hypot(photo.width, photo.height) / photo.focal
    # the focal length is rounded to hundredths of a pixel, the film's diagonal to 1e-4 mm
    rounded = 0.005 / photo.focal + 1e-4 / np.hypot(*FILM)
    assert across == pytest.approx(np.hypot(*FILM) / 28, rel=rounded)
    assert without.focal == 0.0


@pytest.mark.skipif(sys.platform != "linux", reason="limits of files are those of Linux")
def test_a_disk_that_fills_up_is_an_error_and_leaves_no_part_of_a_photo(
    photo_writer, checkout: Path, tmp_path: Path
):
    """Pillow alone leaves off what does not fit and says nothing."""
    photo_writer(tmp_path / "a.png", 400, 300)
    code = (
        "import resource, signal, sys; from pathlib import Path\n"
        "from desplat_ns.process.photos import prepare_photos\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))\n"
        "folder = Path(sys.argv[1])\n"
        "prepare_photos(folder, ['a.png'], folder / 'copies', 400, 1, print)\n"
    )
    line = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(line, cwd=checkout, capture_output=True, text=True)
    assert done.returncode != 0 and "OSError" in done.stderr
    assert not [*(tmp_path / "copies").iterdir()]


def test_files_that_are_no_pictures_and_twins_are_named_and_do_not_stop_the_others(
    photo_writer, tmp_path: Path
):
    photo_writer(tmp_path / "good.png", 60, 40, seed=0)
    photo_writer(tmp_path / "good too.png", 60, 40, seed=0)
    (tmp_path / "empty.jpg").write_bytes(b"")
    (tmp_path / "text.png").write_text("hello")
    (tmp_path / "half.jpg").write_bytes((tmp_path / "good.png").read_bytes()[:700])
    names = sorted(path.name for path in tmp_path.iterdir())
    problems = {photo.source: photo.problem for photo in prepared(tmp_path, *names)}
    same = problems.pop("good.png"), problems.pop("good too.png")
    assert sorted(same)[0] == "" and "good" in sorted(same)[1]
    assert all(" cannot be read: " in problem for problem in problems.values())


@pytest.mark.slow
def test_there_are_no_features_where_a_mask_is_black_and_all_others_stay(
    marked: Features, tmp_path: Path
):
    """One mask for each photo, named as it is, in upper case too."""
    mask = write_mask_of_the_mark(tmp_path / "mask.png")
    (tmp_path / "mine").mkdir()
    for number in range(len(marked.photos)):
        name = f"{number:02d}.PNG" if number % 2 else f"{number:02d}.png.png"
        (tmp_path / "mine" / name).write_bytes(mask.read_bytes())
    database, copies = tmp_path / "database.db", tmp_path / "copies"
    photos = copied(marked.copies.with_name("photos"), copies)
    assert prepare_masks(tmp_path / "mine", photos, tmp_path / "masks") == len(photos)
    features_of(photos, copies, database)
    without, masked = places_of(marked.database), places_of(database)
    for photo in marked.photos:
        before, after = without[photo.copy], masked[photo.copy]
        assert (before[:, 1] > EDGE + ROUNDED).any()
        assert (after[:, 1] < EDGE + ROUNDED).all()
        white = before[before[:, 1] < EDGE - ROUNDED]
        assert len(white) > 0
        np.testing.assert_array_equal(after[after[:, 1] < EDGE - ROUNDED], white)
