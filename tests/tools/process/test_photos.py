"""Copies of photos of every kind, what is known of them, and their masks."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.tools.process.photos import Photo, check_projection, prepare_masks, prepare_photos
from tests.helpers.yard import (
    EDGE,
    Features,
    copied,
    features_of,
    places_of,
    write_mask_of_the_mark,
)

EXIF, FOCAL_35MM = 0x8769, 0xA405
FILM = 36.0, 24.0
"""Millimetres of a picture on 35 mm film, which the focal length of EXIF is for."""
ROUNDED = 1.0
"""Pixels: pycolmap takes the mask's value at the pixel nearest to a feature."""


def prepared(folder: Path, *names: str, longest_side: int = 1600) -> list[Photo]:
    """Photos of `folder` with copies in `folder`/copies."""
    return prepare_photos(folder, names, folder / "copies", longest_side)


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
    rounded = 1e-4 / np.hypot(*FILM)  # of millimetres of the film's diagonal
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
        "from desplat_ns.tools.process.photos import prepare_photos\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))\n"
        "folder = Path(sys.argv[1])\n"
        "prepare_photos(folder, ['a.png'], folder / 'copies', 400)\n"
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


def test_what_is_transparent_gets_no_feature_and_is_written_as_a_png(photo_writer, tmp_path: Path):
    """Also where a mask forbids more; those without alpha are JPEGs, and all of them is allowed."""
    pixels = photo_writer(tmp_path / "photos" / "a.png", 60, 40)
    alpha = np.full((40, 60, 1), 255, np.uint8)
    alpha[:, :20] = 0
    PIL.Image.fromarray(np.dstack([pixels, alpha])).save(tmp_path / "photos" / "a.png")
    photo_writer(tmp_path / "photos" / "b.png", 60, 40, seed=1)
    photos = prepare_photos(tmp_path / "photos", ["a.png", "b.png"], tmp_path / "c", 60)
    assert [photo.name for photo in photos] == ["a.png", "b.jpg"]

    def allowed(photo: Photo) -> np.ndarray:
        return np.array(PIL.Image.open(tmp_path / "masks" / f"{photo.copy}.png"))

    np.testing.assert_array_equal(allowed(photos[0]), alpha[..., 0])
    assert (allowed(photos[1]) == 255).all()
    below = np.repeat(np.array([[255], [0]], np.uint8), 20, axis=0).repeat(60, axis=1)
    PIL.Image.fromarray(below).save(tmp_path / "below.png")
    assert prepare_masks(tmp_path / "below.png", photos, tmp_path / "masks") == 2
    np.testing.assert_array_equal(allowed(photos[0]), np.minimum(alpha[..., 0], below))
    np.testing.assert_array_equal(allowed(photos[1]), below)


def test_masks_of_photos_in_folders_are_found_by_the_names_alone(photo_writer, tmp_path: Path):
    photo_writer(tmp_path / "images" / "a.png", 60, 40)
    photos = prepare_photos(tmp_path, ["images/a.png"], tmp_path / "w" / "c", 60)
    photo_writer(tmp_path / "masks" / "a.jpg.png", 60, 40)
    with pytest.raises(CaptureError, match=r"a\.jpg\.png"):
        prepare_masks(tmp_path / "masks", photos, tmp_path / "w" / "masks")
    photo_writer(tmp_path / "masks" / "a.png", 60, 40)
    assert prepare_masks(tmp_path / "masks", photos, tmp_path / "w" / "masks") == 1


def textured(height: int, width: int, seed: int = 0) -> np.ndarray:
    """Blots of all sizes; left and right edge continue each other."""
    rng, picture = np.random.default_rng(seed), np.zeros((height, width, 3), np.float32)
    for size in (4, 10, 20, 50):
        blots = rng.normal(size=(height // size + 1, width // size, 3)).astype(np.float32)
        padded = np.concatenate([blots[:, -2:], blots, blots[:, :2]], axis=1)
        zoomed = cv2.resize(padded, None, fx=size, fy=size, interpolation=cv2.INTER_CUBIC)
        picture += zoomed[:height, 2 * size : 2 * size + width]
    return np.clip(128 + 35 * picture, 0, 255).astype(np.uint8)


def panorama(seed: int = 0) -> np.ndarray:
    """All around: what is near a pole is drawn out along its row."""
    picture = textured(300, 600, seed).astype(np.float32)
    latitude = np.pi * ((np.arange(300) + 0.5) / 300 - 0.5)
    for row, stretch in zip(picture, 1 / np.cos(latitude), strict=True):
        wide = cv2.blur(np.tile(row[None], (1, 3, 1)), (min(600, int(stretch)), 1))
        row[:] = wide[0, 600:1200]
    return picture.astype(np.uint8)


def two_circles() -> np.ndarray:
    picture = np.zeros((300, 600, 3), np.uint8)
    for x in (149, 449):
        cv2.circle(picture, (x, 149), 147, (1, 1, 1), -1)
    return picture * textured(300, 600)


def is_refused(path: Path, picture: np.ndarray) -> bool:
    try:
        check_projection(path, picture)
    except CaptureError:
        return True
    return False


@pytest.mark.parametrize("seed", range(3))
def test_pictures_all_around_and_two_circles_are_refused(tmp_path: Path, seed: int):
    """However far the camera was turned; with alpha; and as a large JPEG of poor quality."""
    path, picture = tmp_path / "a.png", panorama(seed)
    path.write_bytes(b"no XMP")
    large = cv2.resize(picture, (2400, 1200), interpolation=cv2.INTER_CUBIC)
    poor = cv2.imdecode(cv2.imencode(".jpg", large, [cv2.IMWRITE_JPEG_QUALITY, 70])[1], 1)
    with_alpha = np.dstack([picture, np.full((300, 600, 1), 255, np.uint8)])
    for other in (np.roll(picture, 77, axis=1), with_alpha, poor, two_circles()):
        assert is_refused(path, other)


@pytest.mark.parametrize("kind", ["crop", "tile", "noise", "backdrop", "night", "plain", "3 to 2"])
def test_other_pictures_are_not(tmp_path: Path, kind: str):
    path, rng = tmp_path / "a.png", np.random.default_rng(0)
    path.write_bytes(b"no XMP")
    backdrop = np.full((300, 600, 3), 200.0)  # a table before a wall, with a thing on it
    backdrop[180:] = 90
    backdrop[60:210, 200:400] = textured(150, 200)
    backdrop += rng.normal(0, 4, backdrop.shape)
    night = textured(300, 600) // 12
    night[100:200, 100:500] *= 12
    pictures = {
        "crop": panorama()[60:240, 100:460],
        "tile": textured(300, 600),
        "noise": rng.integers(0, 256, (300, 600, 3), np.uint8),
        "backdrop": backdrop.clip(0, 255).astype(np.uint8),
        "night": night,
        "plain": np.full((300, 600, 3), 128, np.uint8),
        "3 to 2": cv2.resize(panorama(), (450, 300)),
    }
    assert not is_refused(path, pictures[kind])


@pytest.mark.parametrize(
    ("xmp", "refused"),
    [
        (b'<rdf:Description GPano:ProjectionType="equirectangular"/>', True),
        (b"<GPano:ProjectionType>cylindrical</GPano:ProjectionType>", True),
        (b"<GPano:ProjectionType>rectilinear</GPano:ProjectionType>", False),
    ],
)
def test_a_panorama_by_its_xmp_is_refused_whatever_its_shape(
    photo_writer, tmp_path: Path, xmp: bytes, refused: bool
):
    pixels = photo_writer(tmp_path / "a.png", 60, 40)
    PIL.Image.fromarray(pixels).save(tmp_path / "a.jpg", xmp=xmp)
    (photo,) = prepared(tmp_path, "a.jpg")
    assert bool(photo.problem) == refused
