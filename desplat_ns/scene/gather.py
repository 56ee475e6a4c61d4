"""From a trained run to what its page shows, in a few of the photos' lights, and to the page."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.backend.accumulated_weights import accumulated_weights
from desplat_ns.backend.constants import NEAR_PLANE
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.console import announce, progress_over, text_of
from desplat_ns.data.training_views import image_names
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.evaluation.pictures import to_rgb8
from desplat_ns.export.export import reach_of, shown_in, static_cloud
from desplat_ns.export.splat_cloud import SplatCloud, baked, harmonics_of
from desplat_ns.files.pages import LARGEST_SIDE, shrunk
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.gaussians.activation import activate_distractors
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.appearance import as_harmonics
from desplat_ns.photo_tourism.shown_light import VARIABLE
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.rendering.near_plane import scene_start
from desplat_ns.rendering.views import is_distorted
from desplat_ns.runs.files import RunFiles
from desplat_ns.runs.loading import LoadedRun, even_subset, load_run
from desplat_ns.scene.contents import AVERAGE, Contents, Light, PageCamera, Rgb
from desplat_ns.scene.page import html_of

MEGABYTE = 1_000_000

PICTURES = 6
"""Renderings for browsers that cannot draw the scene."""

MORE_LIGHTS = 3
"""Lights beside the one that is shown first."""

MOST_PHOTOS, MOST_GAUSSIANS = 300, 500
"""Photos among which lights are chosen, and Gaussians by whose colours they are compared; of more,
as many evenly chosen."""

ROUNDING = 1e-5
"""Share by which sums of a few hundred distances in float32 may differ though these are equal."""

WEIGHING_VIEWS = 30
"""Training views in which Gaussians are weighed, evenly chosen."""


def write_scene(
    files: RunFiles,
    output: Path,
    most_training: int,
    most_held_out: int,
    megabytes: float,
    crop: float | None,
    light: str | None,
) -> int:
    """Write the page of a run's scene; its size in bytes.

    Args: see `desplat-export page --help`.

    Raises:
        CaptureError: the capture cannot be read any more, or has no camera to start from.
        CheckpointError: no checkpoint is intact.
        ConfigError: an unknown light, nothing left to show, or the page cannot be written.
    """
    contents = gather(load_run(files), most_training, most_held_out, crop, light)
    text, left_out = html_of(contents, int(megabytes * MEGABYTE))
    with plain_errors(output):
        write_whole(output, text.encode())
    size = len(text.encode())
    announce(f"Saved {output}: a page with the scene in it, {size / MEGABYTE:.1f} MB.")
    for line in left_out:
        announce(line, warning=True)
    return size


@torch.no_grad()
def gather(
    run: LoadedRun,
    most_training: int,
    most_held_out: int,
    crop: float | None = None,
    light: str | None = None,
) -> Contents:
    """What the page of a run shows.

    Args:
        most_training: training photos; of more, as many evenly chosen.
        most_held_out: held-out photos, likewise.
        crop, light: see `desplat-export page --help`.

    Raises:
        CaptureError: the run has no camera to start from, or a photo cannot be read any more.
        ConfigError: an unknown light, or no Gaussians are left.
    """
    pipeline = run.pipeline
    model, manager = pipeline.model, pipeline.datamanager
    cloud, rows = static_cloud(pipeline, crop, light)
    training = even_subset(len(manager.train_image_names), most_training)
    held_out = even_subset(len(manager.eval_dataset), most_held_out)
    with (
        shown_in(model, light),
        model.layer_control.suspended(),
        progress_over(len(training) + len(held_out), "Gathering photos...") as advance,
    ):
        cameras = []
        for camera in _page_cameras(pipeline, training, held_out):
            cameras.append(camera)
            advance()
        if not cameras:
            raise CaptureError(
                "There is no camera to start from: the page has no photos. Ask for some: "
                "--training-photos 50."
            )
        pictures = _pictures(model, cameras)
        background = mean_background(model, cameras[0].view, model.embedding_of(None))
        lights = other_lights(model, rows, cameras[0].view)
    return Contents(
        title=str(run.config.experiment_name),
        date=date.fromtimestamp(run.checkpoint.stat().st_mtime).isoformat(),
        cloud=cloud,
        weigh=lambda splats: _weights(pipeline, splats),
        background=background,
        light=light_of(model, light),
        cameras=cameras,
        pictures=pictures,
        other_lights=lights,
        not_shown=_not_shown(pipeline, len(training), len(held_out)),
    )


def _page_cameras(
    pipeline: DeSplatPipeline, training: Sequence[int], held_out: Sequence[int]
) -> Iterator[PageCamera]:
    """The chosen training photos, then the chosen held-out ones."""
    model, manager = pipeline.model, pipeline.datamanager
    dataset, undistorted = manager.train_dataset, None
    if is_distorted(dataset.cameras):
        undistorted = manager.cached_train  # changes the cameras
    for index in training:
        batch = undistorted[index] if undistorted else dataset.get_data(index, "uint8")
        camera, name = dataset.cameras[index : index + 1], manager.train_image_names[index]
        yield _page_camera(model, camera, batch["image"], name, index)
    names = image_names(manager.eval_dataset.image_filenames)
    loader = manager.fixed_indices_eval_dataloader
    for index in held_out:
        camera, batch = loader[index]
        yield _page_camera(model, camera, batch["image"], names[index], None)


def _page_camera(
    model: DeSplatModel, camera: Cameras, photo: Tensor, name: str, index: int | None
) -> PageCamera:
    """One photo's. `index`: which training view it is; None for a held-out one."""
    view = model.view_of_camera(camera.to(model.device), index)
    background = model.background_of(view, model.embedding_of(None))
    shown = model.photo_of({"background": background}, {"image": photo.to(model.device)})
    start = 0.0 if model.points is None else scene_start(model.points, view)
    splats, settings = model.shown_splats(), model.render_settings(depth=True)
    reach = reach_of(view, lambda small: model.rasterizer(splats, small, settings))
    return PageCamera(
        text_of(name),
        index is None,
        view,
        near=max(NEAR_PLANE, model.config.near_plane * start),
        reach=reach or start or 1.0,
        photo=shrunk(to_rgb8(shown.cpu().numpy()), LARGEST_SIDE),
        distractors=None if index is None else _distractors(model, index),
    )


def _distractors(model: DeSplatModel, index: int) -> SplatCloud | None:
    """What was taken out of a training photo."""
    if model.layer is None or len(model.layer.gaussians.views[index]) == 0:
        return None
    splats = activate_distractors(model.layer.gaussians.views[index].params)
    try:
        return baked(splats, model.render_settings(depth=False).antialiased)
    except ConfigError:  # all are too faint to be seen
        return None


def _pictures(model: DeSplatModel, cameras: Sequence[PageCamera]) -> list[tuple[str, Rgb]]:
    """Renderings of the static scene, the first camera's first."""
    chosen = [cameras[i] for i in even_subset(len(cameras), PICTURES)]
    embedding, pictures = model.embedding_of(None), []
    for camera in chosen:
        static = model.render_static(camera.view, embedding)
        background = model.background_of(camera.view, embedding)
        image = model.image_of(static, background, camera.view, embedding).clamp(0, 1)
        pictures.append((camera.name, shrunk(to_rgb8(image.cpu().numpy()), LARGEST_SIDE)))
    return pictures


def _weights(pipeline: DeSplatPipeline, cloud: SplatCloud) -> np.ndarray:
    """Blending weights of Gaussians [N], summed over the pixels of training views."""
    model, manager = pipeline.model, pipeline.datamanager
    splats = splats_of(cloud, model.device)
    cameras = manager.train_dataset.cameras.to(model.device)
    weights = torch.zeros(len(cloud), device=splats.means.device)
    for index in even_subset(len(cameras), WEIGHING_VIEWS):
        view: View = model.view_of_camera(cameras[index : index + 1], index)
        settings = RenderSettings(antialiased=cloud.antialiased)
        weights += accumulated_weights(model.rasterizer, splats, view, settings).detach()
    return weights.cpu().numpy()


def splats_of(cloud: SplatCloud, device: torch.device | str) -> Splats:
    """A file's Gaussians as a rasterizer takes them, in float32."""
    values: Any = (cloud.means, cloud.quats, cloud.scales, cloud.opacities, cloud.harmonics)
    tensors = (torch.as_tensor(value, dtype=torch.float32, device=device) for value in values)
    return Splats(*tensors, sh_degree=cloud.degree)


def _not_shown(pipeline: DeSplatPipeline, training: int, held_out: int) -> str:
    manager = pipeline.datamanager
    all_training, all_held_out = len(manager.train_image_names), len(manager.eval_dataset)
    if training == all_training and held_out == all_held_out:
        return ""
    return (
        f"{training} of {all_training} training photos and {held_out} of {all_held_out} held-out "
        "ones are here, evenly chosen."
    )


# --- lights ----------------------------------------------------------------------------------


def light_of(model: DeSplatModel, light: str | None) -> str:
    """Whose light a page shows; empty where all photos have the same.

    Of cameras' exposures (`camera`) it is always the average: they are no colours of Gaussians.
    """
    if not model.effects.image_light:
        return ""
    if model.effects.appearance == "camera":
        return AVERAGE
    return text_of(light or os.environ.get(VARIABLE) or AVERAGE)


def other_lights(model: DeSplatModel, rows: Tensor, view: View) -> list[Light]:
    """Lights of photos, so chosen that with the one that is shown they stand for those of all.

    None where the Gaussians have the same colours in every light.

    Args:
        rows: which Gaussians [N] of the model are on the page.
        view: for the background: its mean colour there stands for it.
    """
    effects = model.image_effects
    if effects.appearance is None or not model.names:
        return []
    photos = even_subset(len(model.names), MOST_PHOTOS)
    embeddings = [effects.of(photo) for photo in photos]
    shown = model.embedding_of(None)
    among = rows.nonzero()[:, 0]
    some = among[even_subset(len(among), MOST_GAUSSIANS)]
    first, *others = (_colors(model, some, embedding) for embedding in (shown, *embeddings))
    chosen = standing_for_all(torch.stack(others), first, MORE_LIGHTS)
    return list(_baked(model, rows, view, [photos[i] for i in chosen]))


def standing_for_all(
    lights: Float[Tensor, "V C"], first: Float[Tensor, " C"], count: int
) -> list[int]:
    """Which of V lights to take beside the first one: one after the other, each such that all V are
    nearest to those that are taken, in the sum of their distances to the nearest one.

    Fewer than `count` if more would bring nothing nearer.
    """
    exact = "donot_use_mm_for_euclid_dist"  # by products, lights that are equal are 0.01 apart
    among = torch.cdist(lights, lights, compute_mode=exact)
    nearest, chosen = (lights - first).norm(dim=1), []
    while len(chosen) < count:
        left = torch.minimum(nearest, among).sum(dim=1)
        best = int(left.argmin())
        if not left[best] < (1 - ROUNDING) * nearest.sum():
            break
        chosen.append(best)
        nearest = torch.minimum(nearest, among[best])
    return chosen


def _colors(model: DeSplatModel, rows: Tensor, embedding: Tensor) -> Tensor:
    """Colours [C] of some Gaussians without view dependence, in [0, 1], one after the other."""
    with model.shown_in(embedding):
        lit = as_harmonics(model.shown_splats(rows))
    return (C0 * lit.colors[:, 0] + 0.5).clamp(0, 1).flatten()


def _baked(model: DeSplatModel, rows: Tensor, view: View, photos: Sequence[int]) -> Iterator[Light]:
    for photo in photos:
        embedding = model.image_effects.of(photo)
        with model.shown_in(embedding):
            harmonics = harmonics_of(model.shown_splats(rows))
        yield Light(text_of(model.names[photo]), mean_background(model, view, embedding), harmonics)


def mean_background(
    model: DeSplatModel, view: View, embedding: Tensor
) -> tuple[float, float, float]:
    """Colour in [0, 1] that stands for what is behind everything in a view."""
    colors = model.background_of(view, embedding).reshape(-1, 3)
    red, green, blue = colors.mean(dim=0).clamp(0, 1).tolist()
    return red, green, blue
