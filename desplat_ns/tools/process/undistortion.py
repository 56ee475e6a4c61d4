"""The capture: photos without distortion, their model, and a picture of it from above."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image
import pycolmap
from matplotlib.figure import Figure

from desplat_ns.core.console import announce
from desplat_ns.core.cores import cores
from desplat_ns.core.whole import draft_of
from desplat_ns.tools.process.photos import JPEG_QUALITY, Photo, write_picture
from desplat_ns.tools.process.reconstruction import Model
from desplat_ns.tools.process.request import ORIGINALS, Request


def undistort(request: Request, model: Model, photos: Sequence[Photo]) -> None:
    """Write OUTPUT/cameras.png, images, sparse/0 and originals, whole or not at all. Alpha is
    undistorted as its photo is. Raises OSError where photos could not be written as a whole."""
    output, by_copy = request.output, {photo.copy: photo for photo in photos}
    flat = output / "work" / "undistorted"
    shutil.rmtree(flat, ignore_errors=True)
    options = pycolmap.UndistortCameraOptions(max_image_size=request.longest_side)
    announce(f"Undistorting {len(model.photos)} photos.")
    how: dict[str, Any] = {"jpeg_quality": JPEG_QUALITY, "num_threads": cores()}
    places = flat, model.folder, output / "work" / "photos"
    pycolmap.undistort_images(*places, undistort_options=options, **how)
    flat_model = pycolmap.Reconstruction(flat / "sparse")
    bent_model = pycolmap.Reconstruction(model.folder)
    draw_from_above(flat_model, output / "cameras.png")
    named, written, originals = flat / "named", flat / "0", flat / "originals"
    for image_id in flat_model.reg_image_ids():
        image = flat_model.image(image_id)
        photo, copy = by_copy[image.name], flat / "images" / image.name
        if not (copy.is_file() and copy.read_bytes().endswith(b"\xff\xd9")):  # JPEG's end marker
            raise OSError(f"the undistorted {photo.name} is not whole")
        target, image.name = named / photo.name, photo.name
        bent_model.image(image_id).name = photo.source
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.suffix != ".png":
            copy.rename(target)
            continue
        bent = pycolmap.Bitmap.read(output / "work" / "masks" / f"{photo.copy}.png", as_rgb=False)
        lens = bent_model.image(image_id).camera
        assert bent is not None and lens is not None, "both are there before a model is"
        alpha = pycolmap.undistort_image(options, bent, lens)[0].to_array()
        with PIL.Image.open(copy) as picture:
            write_picture(target, np.dstack([np.asarray(picture), alpha]))
    for place, whole in ((written, flat_model), (originals, bent_model)):
        place.mkdir()
        whole.write(place)
        pycolmap.Reconstruction(place)  # a model that a full disk cut off is noticed here
    targets = output / "images", output / ORIGINALS, output / "sparse" / "0"
    for source, target in zip((named, originals, written), targets, strict=True):
        shutil.rmtree(target, ignore_errors=True)
        target.parent.mkdir(parents=True, exist_ok=True)
        source.rename(target)


def draw_from_above(model: pycolmap.Reconstruction, target: Path) -> None:
    """Draw all cameras of a model, where they look, and most of its points."""
    images = [model.image(i) for i in model.reg_image_ids()]
    poses = np.array([image.cam_from_world().matrix() for image in images])
    up = -poses[:, 1, :3].mean(axis=0)
    axes = np.linalg.svd(up[None])[2][1:]  # at right angles to it
    if np.linalg.det([*axes, up]) < 0:  # seen from below
        axes = axes[::-1]
    centres = np.array([image.projection_center() for image in images]) @ axes.T
    forwards = poses[:, 2, :3] @ axes.T
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3) @ axes.T
    colors = np.array([point.color for point in model.points3D.values()]).reshape(-1, 3) / 255
    figure = Figure(figsize=(8, 8), layout="constrained")
    plot = figure.add_subplot(aspect="equal")
    plot.set_title(f"{len(images)} cameras and {len(points)} points from above")
    plot.set_xlabel("cameras red, each with the direction it looks in; the scale is arbitrary")
    plot.quiver(*centres.T, *forwards.T, color="tab:red", angles="xy", scale=25, width=0.002)
    plot.scatter(*centres.T, c="tab:red", s=14, zorder=2)
    if len(points):
        plot.update_datalim(np.quantile(points, [0.05, 0.95], axis=0))
    plot.margins(0.15)
    plot.autoscale_view()
    plot.set_autoscale_on(False)
    plot.scatter(*points.T, c=colors, s=2, linewidths=0)
    with draft_of(target) as draft:
        figure.savefig(draft, dpi=110)
