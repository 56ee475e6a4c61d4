"""From a trained run to what its page shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from typing import Any

import numpy as np
import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.backend.accumulated_weights import accumulated_weights
from desplat_ns.backend.constants import NEAR_PLANE
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.console import progress_over, text_of
from desplat_ns.data.training_views import image_names
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.evaluation.pictures import to_rgb8
from desplat_ns.export.baked import baked
from desplat_ns.export.export import shown_in, static_cloud
from desplat_ns.export.splat_cloud import SplatCloud
from desplat_ns.export.surroundings import reach_of
from desplat_ns.files.pages import LARGEST_SIDE, shrunk
from desplat_ns.gaussians.activation import activate_distractors
from desplat_ns.model import DeSplatModel
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.rendering.near_plane import scene_start
from desplat_ns.rendering.views import is_distorted
from desplat_ns.runs.loading import LoadedRun, even_subset
from desplat_ns.scene.contents import Contents, PageCamera, Rgb
from desplat_ns.scene.lights import light_of, mean_background, other_lights

PICTURES = 6
"""Renderings for browsers that cannot draw the scene."""

WEIGHING_VIEWS = 30
"""Training views in which Gaussians are weighed, evenly chosen."""


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
