"""From a trained run to what its page shows, in a few of the photos' lights.

Letters in shapes: N Gaussians, H x W pixels."""

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.backend.accumulated_weights import accumulated_weights
from desplat_ns.backend.constants import NEAR_PLANE
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.cameras.near_plane import scene_start
from desplat_ns.core.console import progress_over, text_of
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.pages import Picture, picture_of
from desplat_ns.data.training_views import even_subset, image_names
from desplat_ns.gaussians.activation import activate_distractors
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.shown_light import VARIABLE
from desplat_ns.tools.export.export import reach_of, shown_in, static_cloud
from desplat_ns.tools.export.formats import Y_UP
from desplat_ns.tools.export.splat_cloud import Similarity, SplatCloud, baked, harmonics_of
from desplat_ns.tools.loading import LoadedRun
from desplat_ns.training.pipeline import DeSplatPipeline

AVERAGE = "the photos' average"
"""Whose light is shown where none was chosen."""
PICTURES = 6
"""Renderings for browsers that cannot draw the scene."""
MORE_LIGHTS = 3
"""Photos' lights beside the one that is shown first, evenly chosen."""
WEIGHING_VIEWS = 30
"""Training views in which Gaussians are weighed, evenly chosen."""
Color = tuple[float, float, float]
"""Red, green and blue in [0, 1]."""
TO_PAGE = Similarity(np.asarray(Y_UP, np.float64), 1.0, np.zeros(3))
"""From nerfstudio's coordinates to the page's, where y is up; the scale stays that of training."""


@dataclass(frozen=True)
class PageCamera:
    """A photo's camera, and what belongs to it; lengths and places as in training."""

    name: str
    held_out: bool
    view: View
    near: float
    """What is nearer is not shown there."""
    reach: float
    """Median depth of what is shown there."""
    photo: Picture
    distractors: SplatCloud | None = None
    """What was taken out of the photo; None if nothing was."""

    def as_json(self) -> dict[str, Any]:
        """As the page's script reads it: the pose, camera to world in OpenGL's axes, by columns."""
        pose = np.linalg.inv(self.view.viewmat.double().cpu().numpy())
        pose = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3] = TO_PAGE.turn @ pose[:3]
        intrinsics = self.view.K.double().cpu().numpy()
        return {
            "name": self.name,
            "heldOut": self.held_out,
            "size": [self.view.width, self.view.height],
            "lens": [float(intrinsics[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))],
            "pose": pose.T.ravel().tolist(),
            "near": self.near,
            "reach": self.reach,
        }


@dataclass(frozen=True)
class Light:
    """A light in which the scene can be shown: a photo's."""

    name: str
    background: Color
    """Behind everything."""
    harmonics: Float[np.ndarray, "N K 3"]
    """Of the scene's Gaussians, as `SplatCloud.harmonics`."""


@dataclass(frozen=True)
class PageScene:
    """All that is on a page."""

    title: str
    date: str
    """When the run was trained, in ISO's form."""
    cloud: SplatCloud
    """The static scene, in the coordinates of training."""
    weigh: Callable[[SplatCloud], Float[np.ndarray, " N"]]
    """How much each of its Gaussians makes up of the photos; asked for if not all fit."""
    background: Color
    """Behind everything: the mean of what is behind the first photo."""
    light: str
    """Whose light is shown: a photo, or `AVERAGE`; empty where all photos have the same."""
    cameras: Sequence[PageCamera]
    pictures: Sequence[tuple[str, Picture]]
    """Renderings with their names, for browsers that cannot draw the scene."""
    other_lights: Sequence[Light] = ()
    """To choose from beside it."""
    not_shown: str = ""
    """In words, which photos are not on the page."""


@torch.no_grad()
def scene_of(
    run: LoadedRun,
    most_training: int,
    most_held_out: int,
    crop: float | None = None,
    light: str | None = None,
) -> PageScene:
    """What the page of a run shows, by what `desplat-export page` takes. Raises CaptureError where
    there is no photo to start from, ConfigError where no Gaussians are left."""
    pipeline = run.pipeline
    model, manager = pipeline.model, pipeline.datamanager
    cloud, rows = static_cloud(pipeline, crop, light)
    totals = len(manager.train_image_names), len(manager.eval_dataset)
    training, held_out = map(even_subset, totals, (most_training, most_held_out))
    if not training and not held_out:
        raise CaptureError("The page has no photo to start from. Add --training-photos 50.")
    counts, not_shown = (len(training), len(held_out)), ""
    if counts != totals:
        some, others = (f"{few} of {whole}" for few, whole in zip(counts, totals, strict=True))
        not_shown = f"{some} training photos and {others} held-out ones are here, evenly chosen."
    cameras = []
    with (
        shown_in(model, light),
        model.layer_control.suspended(),
        progress_over(sum(counts), "Gathering photos...") as advance,
    ):
        for index, camera, batch in manager.training_images(training):
            name = manager.train_image_names[index]
            cameras.append(_page_camera(model, camera, batch["image"], name, index))
            advance()
        names = image_names(manager.eval_dataset.image_filenames)
        for index in held_out:
            camera, batch = manager.fixed_indices_eval_dataloader[index]
            cameras.append(_page_camera(model, camera, batch["image"], names[index], None))
            advance()
        shown = model.embedding_of(None)
        return PageScene(
            title=str(run.config.experiment_name),
            date=date.fromtimestamp(run.checkpoint.stat().st_mtime).isoformat(),
            cloud=cloud,
            weigh=lambda splats: _weights(pipeline, splats),
            background=mean_background(model, cameras[0].view, shown),
            light=light_of(model, light),
            cameras=cameras,
            pictures=[
                (cameras[i].name, _picture(model, cameras[i].view, shown))
                for i in even_subset(len(cameras), PICTURES)
            ],
            other_lights=other_lights(model, rows, cameras[0].view),
            not_shown=not_shown,
        )


def _page_camera(
    model: DeSplatModel, camera: Cameras, photo: Tensor, name: str, index: int | None
) -> PageCamera:
    """One photo's. `index`: which training view it is; None for a held-out one."""
    view = model.view_of_camera(camera.to(model.device), index)
    background = model.background_of(view, model.embedding_of(None))
    shown = model.photo_of(background, photo)
    start = 0.0 if model.points is None else scene_start(model.points, view)
    splats, settings = model.shown_splats(), model.render_settings(depth=True)
    reach = reach_of(view, lambda small: model.rasterizer(splats, small, settings))
    return PageCamera(
        text_of(name),
        index is None,
        view,
        near=max(NEAR_PLANE, model.config.near_plane * start),
        reach=reach or start or 1.0,
        photo=picture_of(shown),
        distractors=None if index is None else _distractors(model, index),
    )


def _distractors(model: DeSplatModel, index: int) -> SplatCloud | None:
    """What was taken out of a training photo."""
    if model.distractors is None:
        return None
    splats = activate_distractors(model.distractors.views[index].params)
    with suppress(ConfigError):  # none, or all are too faint to be seen
        return baked(splats, model.render_settings(depth=False).antialiased)


def _picture(model: DeSplatModel, view: View, embedding: Tensor) -> Picture:
    background = model.background_of(view, embedding)
    drawn = model.render_static(view, embedding)
    return picture_of(model.image_of(drawn, background, view, embedding))


def _weights(pipeline: DeSplatPipeline, cloud: SplatCloud) -> np.ndarray:
    """Blending weights of Gaussians [N], summed over the pixels of training views."""
    model, manager = pipeline.model, pipeline.datamanager
    values: Any = (cloud.means, cloud.quats, cloud.scales, cloud.opacities, cloud.harmonics)
    tensors = (torch.as_tensor(each, dtype=torch.float32, device=model.device) for each in values)
    splats = Splats(*tensors, sh_degree=cloud.degree)
    settings = RenderSettings(antialiased=cloud.antialiased)
    cameras = manager.train_dataset.cameras.to(model.device)
    weights = torch.zeros(len(cloud), device=splats.means.device)
    for index in even_subset(len(cameras), WEIGHING_VIEWS):
        view = model.view_of_camera(cameras[index : index + 1], index)
        weights += accumulated_weights(model.rasterizer, splats, view, settings).detach()
    return weights.cpu().numpy()


def light_of(model: DeSplatModel, light: str | None) -> str:
    """Whose light a page shows; empty where all photos have the same. Of cameras' exposures
    (`camera`) it is always the average: they are no colours of Gaussians."""
    if not model.effects.image_light:
        return ""
    if model.effects.appearance == "camera":
        return AVERAGE
    return text_of(light or os.environ.get(VARIABLE) or AVERAGE)


def other_lights(model: DeSplatModel, rows: Tensor, view: View) -> list[Light]:
    """Lights of a few photos, over the Gaussians in `rows` [N]; none where Gaussians have the same
    colours in every light. The background's mean colour in `view` stands for it."""
    effects, lights = model.image_effects, list[Light]()
    if effects.appearance is None:
        return lights
    for photo in even_subset(len(model.names), MORE_LIGHTS):
        embedding = effects.of(photo)
        background = mean_background(model, view, embedding)
        with model.shown_light.fixed(embedding):
            harmonics = harmonics_of(model.shown_splats(rows))
        lights.append(Light(text_of(model.names[photo]), background, harmonics))
    return lights


def mean_background(model: DeSplatModel, view: View, embedding: Tensor) -> Color:
    """Colour that stands for what is behind everything in a view."""
    colors = model.background_of(view, embedding).reshape(-1, 3)
    red, green, blue = colors.mean(dim=0).clamp(0, 1).tolist()
    return red, green, blue
