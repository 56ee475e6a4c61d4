"""The capture: photos without distortion, the model that goes with them, and a picture of cameras
and points from above. Runs in the worker.

Letters in shapes: N cameras, P points.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
from jaxtyping import Float
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from desplat_ns.console import twice_a_second
from desplat_ns.process.features import Progress
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
    progress: Progress,
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
    options = pycolmap.UndistortCameraOptions()
    options.max_image_size = longest_side
    total = pycolmap.Reconstruction(model).num_reg_images()

    def tell() -> None:  # pycolmap does not say itself how many photos are there
        progress(sum(1 for _ in (flat / "images").glob("*.jpg")), total)

    with twice_a_second(tell):
        pycolmap.undistort_images(
            flat,
            model,
            photos,
            undistort_options=options,
            jpeg_quality=JPEG_QUALITY,
            num_threads=threads,
        )
    flat_model = pycolmap.Reconstruction(flat / "sparse")
    copies = [flat_model.image(i).name for i in flat_model.reg_image_ids()]
    broken = [copy for copy in copies if not _ends_as_jpeg(flat / "images" / copy)]
    if broken:
        raise OSError(f"{len(broken)} of {len(copies)} undistorted photos are not whole")
    draw_from_above(flat_model, output / "cameras.png")
    _hand_over(flat_model, flat, output, names)


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


def _ends_as_jpeg(path: Path) -> bool:
    """Whether a file is there and has JPEG's end marker, so that it is whole."""
    return path.is_file() and path.read_bytes()[-2:] == b"\xff\xd9"


def draw_from_above(model: pycolmap.Reconstruction, target: Path) -> None:
    """Draw where a model's cameras are, where they look, and its points."""
    images = [model.image(i) for i in model.reg_image_ids()]
    poses = np.array([image.cam_from_world().matrix() for image in images])
    axes = ground_axes(-poses[:, 1, :3], poses[:, 2, :3])
    centres = np.array([image.projection_center() for image in images]) @ axes.T
    forwards = poses[:, 2, :3] @ axes.T
    chosen = list(model.points3D.values())[:: max(1, model.num_points3D() // MOST_POINTS)]
    points = np.array([point.xyz for point in chosen]).reshape(-1, 3) @ axes.T
    colors = np.array([point.color for point in chosen]).reshape(-1, 3) / 255
    low, high = _window(centres, points)
    figure = Figure(figsize=(8, 8), layout="constrained")
    plot = figure.add_subplot()
    inside = ((points >= low) & (points <= high)).all(axis=1)
    plot.scatter(*points[inside].T, c=colors[inside], s=2, linewidths=0)
    ends = centres + 0.04 * float((high - low).max()) * forwards
    lines = np.stack([centres, ends], axis=1)
    plot.add_collection(LineCollection(list(lines), colors="tab:red", linewidths=1))
    plot.scatter(*centres.T, c="tab:red", s=14)
    title = f"{len(images)} cameras and {model.num_points3D()} points from above"
    plot.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", title=title)
    plot.set_xlabel("cameras red, each with the direction it looks in; the scale is arbitrary")
    figure.savefig(target, dpi=110)


def ground_axes(
    ups: Float[np.ndarray, "N 3"], forwards: Float[np.ndarray, "N 3"]
) -> Float[np.ndarray, "2 3"]:
    """Two directions at right angles to the mean up: what is to the right, and ahead.

    Args:
        ups, forwards: of the cameras, of length 1, in the world.
    """
    up = ups.mean(axis=0)
    up /= max(float(np.linalg.norm(up)), 1e-9)
    ahead = forwards.mean(axis=0)
    ahead = ahead - (ahead @ up) * up
    if np.linalg.norm(ahead) < 0.1:  # cameras look inwards from all around, or straight down
        ahead = np.linalg.svd(up[None])[2][1]
    ahead = ahead / np.linalg.norm(ahead)
    return np.stack([np.cross(ahead, up), ahead])


def _window(
    centres: Float[np.ndarray, "N 2"], points: Float[np.ndarray, "P 2"]
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Lower and upper corner: all cameras and most points, those far behind left out."""
    low, high = centres.min(axis=0), centres.max(axis=0)
    if len(points):
        near = np.quantile(points, [0.05, 0.95], axis=0)
        low, high = np.minimum(low, near[0]), np.maximum(high, near[1])
    reach = BORDER * float((high - low).max() or 1.0)
    return low - reach, high + reach
