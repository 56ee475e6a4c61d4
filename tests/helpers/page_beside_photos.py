"""A trained run's page in a browser, beside our own renderings and the photos."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from desplat_ns.runs.loading import LoadedRun
from desplat_ns.scene.gather import gather
from desplat_ns.scene.page import html_of
from tests.helpers.scene import psnr
from tests.helpers.scene_in_browser import bare_scene, settle, shown

CAMERAS = 2
"""Of the training photos, and as many of the held-out ones: a browser without a GPU takes seconds
for each."""

LEAST_PSNR = 40.0
"""dB, of the page's picture against ours. SPZ rounds colours to steps of 1/136 and opacities to
steps of 1/255: 0.01 make 40 dB. The screen's 8 bits add 59 dB, blending in 16 bits 66 dB."""

MOST_BELOW = 0.3
"""dB that the page may be less like a photo than our rendering."""


@dataclass(frozen=True)
class Beside:
    """Of each camera, in dB."""

    of_ours: np.ndarray
    """The page's picture, against our rendering."""
    below_ours: np.ndarray
    """By how much less the page's picture is like the photo than our rendering is."""


def page_beside_photos(run: LoadedRun, folder: Path) -> Beside:
    """At `CAMERAS` training cameras and as many held-out ones."""
    model: Any = run.pipeline.model
    contents = gather(run, CAMERAS, CAMERAS)
    assert len(contents.cameras) == 2 * CAMERAS
    text, _ = html_of(contents, 50_000_000)
    of_ours, below_ours = [], []
    with bare_scene(folder / "a.html", text, 100, 100) as page:
        for index, camera in enumerate(contents.cameras):
            page.resize(camera.view.width, camera.view.height)
            settle(page, f"scenePage.goTo({index})")
            with torch.no_grad():
                static = model.render_static(camera.view, model.embedding_of(None))
                light = model.embedding_of(None)
                background = model.background_of(camera.view, light)
                ours = model.image_of(static, background, camera.view, light).clamp(0, 1).numpy()
            picture, photo = shown(page), camera.photo / 255
            of_ours.append(psnr(picture, ours))
            below_ours.append(psnr(ours, photo) - psnr(picture, photo))
    return Beside(np.array(of_ours), np.array(below_ours))


def short_run(data: Path, downscale: int, steps: int, output: Path) -> Path:
    """config.yml of a run of `desplat` on a capture in RobustNeRF's layout, with distractors."""
    from nerfstudio.configs.method_configs import all_methods
    from nerfstudio.scripts import train

    from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
    from desplat_ns.settings.effects import EffectsConfig

    config: Any = copy.deepcopy(all_methods["desplat"])
    config.pipeline.datamanager.dataparser = RobustNerfDataParserConfig(
        data=data, downscale_factor=downscale
    )
    config.pipeline.model.effects = EffectsConfig()
    config.pipeline.model.backend = "numba"
    config.max_num_iterations, config.vis, config.timestamp = steps, "tensorboard", "run"
    config.steps_per_eval_image = config.steps_per_eval_all_images = steps * 10
    config.output_dir = output
    train.main(config)
    return config.get_base_dir() / "config.yml"
