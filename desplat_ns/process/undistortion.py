"""The capture: photos without distortion, the model that goes with them, and a picture of cameras
and points from above.
"""

from __future__ import annotations

import io
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
from jaxtyping import Float
from matplotlib.figure import Figure

from desplat_ns.files.whole import write_whole
from desplat_ns.process.photos import JPEG_QUALITY

MOST_POINTS = 30_000
"""In the picture from above."""
BORDER = 0.15
"""Of the extent of cameras and most points: what is shown around them."""


def undistort(
    model: Path,
    photos: Path,
    output: Path,
    names: Mapping[str, str],
    longest_side: int,
    threads: int,
) -> None:
    """Write `output`/cameras.png, `output`/images and `output`/sparse/0, whole or not at all.

    Args:
        photos: folder of the copies.
        names: what each copy is called in the capture.
        longest_side: pixels that no undistorted photo exceeds.

    Raises:
        OSError: photos could not be written as a whole.
    """
    flat = output / "work" / "undistorted"
    shutil.rmtree(flat, ignore_errors=True)
    options = pycolmap.UndistortCameraOptions(max_image_size=longest_side)
    pycolmap.undistort_images(
        flat,
        model,
        photos,
        undistort_options=options,
        jpeg_quality=JPEG_QUALITY,
        num_threads=threads,
    )
    flat_model = pycolmap.Reconstruction(flat / "sparse")
    draw_from_above(flat_model, output / "cameras.png")
    named, written = flat / "named", flat / "0"
    for image_id in flat_model.reg_image_ids():
        image = flat_model.image(image_id)
        copy, target = flat / "images" / image.name, named / names[image.name]
        if not (copy.is_file() and copy.read_bytes().endswith(b"\xff\xd9")):  # JPEG's end marker
            raise OSError(f"the undistorted {names[image.name]} is not whole")
        target.parent.mkdir(parents=True, exist_ok=True)
        copy.rename(target)
        image.name = names[image.name]
    written.mkdir()
    flat_model.write(written)
    pycolmap.Reconstruction(written)  # a model that a full disk cut off is noticed here
    for source, target in ((named, output / "images"), (written, output / "sparse" / "0")):
        shutil.rmtree(target, ignore_errors=True)
        target.parent.mkdir(parents=True, exist_ok=True)
        source.rename(target)


def draw_from_above(model: pycolmap.Reconstruction, target: Path) -> None:
    """Draw where a model's cameras are, where they look, and its points."""
    images = [model.image(i) for i in model.reg_image_ids()]
    poses = np.array([image.cam_from_world().matrix() for image in images])
    axes = ground_axes(-poses[:, 1, :3].mean(axis=0), poses[:, 2, :3].mean(axis=0))
    centres = np.array([image.projection_center() for image in images]) @ axes.T
    forwards = poses[:, 2, :3] @ axes.T
    chosen = list(model.points3D.values())[:: max(1, model.num_points3D() // MOST_POINTS)]
    points = np.array([point.xyz for point in chosen]).reshape(-1, 3) @ axes.T
    colors = np.array([point.color for point in chosen]).reshape(-1, 3) / 255
    most = np.quantile(points, [0.05, 0.95], axis=0) if len(points) else centres[:0]
    framed = np.concatenate([centres, most])  # all cameras and most points
    low, high = framed.min(axis=0), framed.max(axis=0)
    border = BORDER * (float((high - low).max()) or 1.0)
    figure = Figure(figsize=(8, 8), layout="constrained")
    plot = figure.add_subplot()
    plot.scatter(*points.T, c=colors, s=2, linewidths=0)
    plot.quiver(*centres.T, *forwards.T, color="tab:red", angles="xy", scale=25, width=0.002)
    plot.scatter(*centres.T, c="tab:red", s=14)
    title = f"{len(images)} cameras and {model.num_points3D()} points from above"
    (left, low_y), (right, high_y) = low - border, high + border
    plot.set(xlim=(left, right), ylim=(low_y, high_y), aspect="equal", title=title)
    plot.set_xlabel("cameras red, each with the direction it looks in; the scale is arbitrary")
    encoded = io.BytesIO()
    figure.savefig(encoded, dpi=110, format="png")
    write_whole(target, encoded.getvalue())


def ground_axes(
    up: Float[np.ndarray, "3"], ahead: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "2 3"]:
    """Two directions at right angles to up, which need not have length 1: to the right of the way
    ahead, and ahead on the ground."""
    right = np.cross(ahead, up)
    if np.linalg.norm(right) < 0.1:  # cameras look inwards from all around, or straight down
        right = np.linalg.svd(up[None])[2][1]
    axes = np.stack([right, np.cross(up, right)])
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)
