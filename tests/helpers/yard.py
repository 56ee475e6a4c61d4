"""A dozen views of the generated yard, as photos without poses, for what pycolmap does."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
import pycolmap
from jaxtyping import Float, UInt8

from desplat_ns.tools.process.photos import Photo, group_by_camera, prepare_photos
from desplat_ns.tools.process.reconstruction import PLAIN, enter_photos, find_features
from lab.pictures import write_image
from lab.process import distances
from lab.synthetic import SceneSpec, make_scene

VIEWS = SceneSpec(
    num_views=12, num_extras=1, width=320, height=240, arc_degrees=60.0, supersample=1
)
"""Neighbours are 5.5 degrees apart; the first pair that COLMAP starts from needs 16."""
SIZE = VIEWS.width, VIEWS.height
MARK_ROWS = SIZE[1] // 4
EDGE = SIZE[1] - MARK_ROWS
"""The first row that a mark covers."""

FRAMES_OF_A_VIEW = 3
BLUR = 2.0
"""Pixels, standard deviation."""


@dataclass(frozen=True)
class Yard:
    """The views, in the order in which the camera goes around."""

    pictures: Sequence[UInt8[np.ndarray, "H W 3"]]
    centres: Float[np.ndarray, "V 3"]
    """Of the cameras, metres."""
    pixel: float
    """Metres: what moves the middle of the scene by one pixel."""

    def write(self, folder: Path, order: Sequence[int], is_marked: bool = False) -> Path:
        """Some views as photos `00.png`, `01.png`, ... in this order.

        Args:
            is_marked: whether `mark` covers the lowest rows of each.
        """
        for number, view in enumerate(order):
            picture = self.pictures[view].copy()
            if is_marked:
                picture[EDGE:] = mark()
            write_image(folder / f"{number:02d}.png", picture)
        return folder

    def features(self, folder: Path, order: Sequence[int], is_marked: bool = False) -> "Features":
        """Some views as photos, copied, with plain features in a database; all of it in a folder,
        where a second call goes on."""
        photos = copied(self.write(folder / "photos", order, is_marked), folder / "copies")
        return features_of(photos, folder / "copies", folder / "database.db")

    def film(self, path: Path, options: Sequence[str] = ()) -> Path:
        """A video that rests at each view, which is blurred, then sharp, then blurred again.

        Args:
            options: further ones of ffmpeg.
        """
        writer = imageio_ffmpeg.write_frames(
            str(path), SIZE, fps=10, quality=9, output_params=[*options]
        )
        writer.send(None)
        for picture in self.pictures:
            blurred = cv2.GaussianBlur(picture, (0, 0), BLUR)
            for frame in (blurred, picture, blurred):
                writer.send(np.ascontiguousarray(frame))
        writer.close()
        return path

    def farthest(self, model: Path, views: dict[str, int]) -> float:
        """How far a camera of a model is from where it was, in pixels that the middle of the scene
        moves, after the similarity that fits all best.

        Args:
            views: the view that each photo of the model shows. All have to be in it.
        """
        read = pycolmap.Reconstruction(model)
        images = {read.image(i).name: read.image(i) for i in read.reg_image_ids()}
        assert images.keys() == views.keys()
        true = self.centres[list(views.values())]
        centres = np.stack([images[name].projection_center() for name in views])
        return float(distances(centres, true).max()) / self.pixel


CLOSE = pycolmap.IncrementalMapperOptions().filter_max_reproj_error
"""Pixels that an observation of a model may be off at most, which is 4. A camera that is farther
off sees the middle of the scene where no observation is left. Its neighbours are 30 off or more."""


def view_of(frame: str) -> int:
    """The view that a frame of the film shows, which is named by its number."""
    return int(Path(frame).stem.rpartition("_")[2]) // FRAMES_OF_A_VIEW


def mark() -> UInt8[np.ndarray, "h W 3"]:
    """What stands still in photos, as a dashboard does: a pattern with features everywhere."""
    cells = (MARK_ROWS // 4, SIZE[0] // 4, 3)
    pattern = np.random.default_rng(5).integers(0, 256, cells, np.uint8)
    return pattern.repeat(4, axis=0).repeat(4, axis=1)


def write_mask_of_the_mark(path: Path) -> Path:
    """A picture that is black where `mark` is."""
    mask = np.full(SIZE[::-1], 255, np.uint8)
    mask[EDGE:] = 0
    write_image(path, mask)
    return path


def make_yard() -> Yard:
    frames = make_scene(VIEWS).clean
    centres = np.stack([frame.camera.position for frame in frames])
    middle = np.linalg.norm(centres[:, :2], axis=1).mean()
    return Yard([frame.image for frame in frames], centres, middle / frames[0].camera.K[0, 0])


@dataclass(frozen=True)
class Features:
    """Photos whose features are in a database."""

    database: Path
    copies: Path
    photos: Sequence[Photo]

    def again(self, folder: Path) -> "Features":
        """The same with a database of its own, to be changed."""
        database = Path(shutil.copy(self.database, folder / "database.db"))
        return Features(database, self.copies, self.photos)


def copied(photos: Path, folder: Path) -> list[Photo]:
    """The photos of a folder, copied as the first stage does."""
    names = sorted(path.name for path in photos.iterdir())
    return prepare_photos(photos, names, folder, max(SIZE))


def features_of(photos: Sequence[Photo], copies: Path, database: Path) -> Features:
    """The photos' plain features, in a new database."""
    enter_photos(database, copies, group_by_camera(photos, "auto"), "auto")
    find_features(database, copies, PLAIN)
    return Features(database, copies, photos)


def places_of(database: Path) -> dict[str, Float[np.ndarray, "_ 2"]]:
    """Pixels of each photo's features."""
    with pycolmap.Database.open(database) as db:
        return {
            image.name: db.read_keypoints(image.image_id)[:, :2].astype(float)
            for image in db.read_all_images()
        }
