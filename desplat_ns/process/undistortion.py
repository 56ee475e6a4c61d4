"""The capture: photos without distortion and the model that goes with them. Runs in the worker."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from threading import Event, Thread

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap

from desplat_ns.process.features import Progress
from desplat_ns.process.photos import JPEG_QUALITY, ends_as_jpeg

MOST_POINTS = 30_000
"""In the picture from above."""


def undistort(
    model: Path,
    photos: Path,
    output: Path,
    names: Mapping[str, str],
    longest_side: int,
    threads: int,
    progress: Progress,
) -> None:
    """Write `output`/images and `output`/sparse/0, whole or not at all.

    Args:
        photos: folder of the copies.
        names: what each copy is called in the capture.
        longest_side: pixels that no undistorted photo exceeds.

    Raises:
        OSError: photos could not be written as a whole.
    """
    flat = output / "work" / "undistorted"
    shutil.rmtree(flat, ignore_errors=True)
    options = pycolmap.UndistortCameraOptions()
    options.max_image_size = longest_side
    total = pycolmap.Reconstruction(model).num_reg_images()
    with _Watched(flat / "images", total, progress):
        pycolmap.undistort_images(
            flat,
            model,
            photos,
            undistort_options=options,
            jpeg_quality=JPEG_QUALITY,
            num_threads=threads,
        )
    found = pycolmap.Reconstruction(flat / "sparse")
    copies = [found.image(i).name for i in found.reg_image_ids()]
    broken = [copy for copy in copies if not ends_as_jpeg(flat / "images" / copy)]
    if broken:
        raise OSError(f"{len(broken)} of {len(copies)} undistorted photos are not whole")
    _write_view(found, output / "work" / "view.npz")
    _hand_over(found, flat, output, names)


def _hand_over(
    model: pycolmap.Reconstruction, flat: Path, output: Path, names: Mapping[str, str]
) -> None:
    """Give photos their names, and put both parts in their places; the model last."""
    named = flat / "named"
    for image_id in model.reg_image_ids():
        image = model.image(image_id)
        target = named / names[image.name]
        target.parent.mkdir(parents=True, exist_ok=True)
        (flat / "images" / image.name).rename(target)
        image.name = names[image.name]
    written = flat / "0"
    written.mkdir()
    model.write(written)
    pycolmap.Reconstruction(written)  # a model that a full disk cut off is noticed here
    for source, target in ((named, output / "images"), (written, output / "sparse" / "0")):
        shutil.rmtree(target, ignore_errors=True)
        target.parent.mkdir(parents=True, exist_ok=True)
        source.rename(target)


def _write_view(model: pycolmap.Reconstruction, path: Path) -> None:
    """What the picture from above shows: camera centres, their axes, points and colours."""
    images = [model.image(i) for i in model.reg_image_ids()]
    poses = [image.cam_from_world().matrix() for image in images]
    points = list(model.points3D.values())[:: max(1, model.num_points3D() // MOST_POINTS)]
    np.savez(
        path,
        centres=np.array([image.projection_center() for image in images]),
        forwards=np.array([pose[2, :3] for pose in poses]),
        ups=np.array([-pose[1, :3] for pose in poses]),
        points=np.array([point.xyz for point in points]).reshape(-1, 3),
        colors=np.array([point.color for point in points], dtype=np.uint8).reshape(-1, 3),
    )


class _Watched:
    """Tells while pycolmap works how many photos are there: it does not say itself."""

    def __init__(self, folder: Path, total: int, progress: Progress) -> None:
        self.folder, self.total, self.progress = folder, total, progress
        self.over = Event()
        self.thread = Thread(target=self._watch, daemon=True)

    def _watch(self) -> None:
        while not self.over.wait(0.5):
            there = sum(1 for _ in self.folder.glob("*.jpg")) if self.folder.is_dir() else 0
            self.progress(there, self.total)

    def __enter__(self) -> None:
        self.thread.start()

    def __exit__(self, *_: object) -> None:
        self.over.set()
        self.thread.join()
        self.progress(self.total, self.total)
