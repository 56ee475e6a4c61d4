"""Steps of nerfstudio's Splatfacto and of DeSplat on the same scenes."""

from __future__ import annotations

import torch
from nerfstudio.data.scene_box import SceneBox
from nerfstudio.engine.optimizers import AdamOptimizerConfig, Optimizers
from nerfstudio.models.splatfacto import SplatfactoModel, SplatfactoModelConfig

from desplat_ns.calibration.model_step import LATE, ModelStep, cameras_of
from desplat_ns.calibration.scenes import Scene
from desplat_ns.nerfstudio_quirks import splatfacto_modules_without_downloads
from desplat_ns.settings.effects import Effects
from lab.gpu.plan import Job

SIZES = ((100_000, 648, 420), (300_000, 1008, 756))
"""Gaussians, width and height: a capture at an eighth of its photos' size, and one at a quarter."""

QUICK_SIZES = ((300, 64, 48),)

VIEWS = 8

SPLATFACTO = "Splatfacto"
PLAIN = "DeSplat, distractors off"
NONE_PLACED = "DeSplat, none placed in this view"
PLACED = "DeSplat, 1,000 in this view"

PER_VIEW = 1_000
"""Distractors where some are placed: as many as the paper starts each view with."""


class SplatfactoStep:
    """nerfstudio's Splatfacto with its own Adam, on the scene and at the step of `ModelStep`."""

    def __init__(self, scene: Scene, device: str) -> None:
        cameras = cameras_of(scene, VIEWS).to(device)
        config = SplatfactoModelConfig()
        config.num_downscales = 0
        torch.manual_seed(0)
        points = scene.params["means"]
        no_colors = torch.zeros(0, 3)  # or it would want them on the GPU before the model is
        with splatfacto_modules_without_downloads():
            self.model: SplatfactoModel = config.setup(
                scene_box=SceneBox(torch.tensor([[-1.0] * 3, [1.0] * 3])),
                num_train_data=VIEWS,
                metadata={"train_cameras": cameras},
                seed_points=(points.clone(), no_colors),
            )
        for name, value in scene.params.items():
            self.model.gauss_params[name].data = value.clone()
        self.model.to(device).train()
        self.model.step = LATE
        self.camera = cameras[:1]
        self.photo = torch.rand(scene.view.height, scene.view.width, 3).to(device)
        groups = {name: group for name, group in self.model.get_param_groups().items() if group}
        adam = {"optimizer": AdamOptimizerConfig(lr=0.0, eps=1e-15), "scheduler": None}
        self.optimizers = Optimizers(dict.fromkeys(groups, adam), groups)
        self.model.optimizers = self.optimizers.optimizers

    def __call__(self) -> None:
        """Draw, weigh, pull back and step; nothing is densified."""
        self.optimizers.zero_grad_all()
        losses = self.model.get_loss_dict(self.model(self.camera), {"image": self.photo})
        torch.stack(list(losses.values())).sum().backward()
        self.optimizers.optimizer_step_all()
        if self.photo.is_cuda:
            torch.cuda.synchronize()


def desplat_step(job: Job, scene: Scene, distractors: int | None) -> ModelStep:
    """DeSplat's step.

    Args:
        distractors: of the view that is drawn; None for a model without any.
    """
    effects = Effects(distractors=distractors is not None)
    backend = job.backend
    return ModelStep(scene, effects, VIEWS, job.device, backend, distractors or 0)  # pyright: ignore[reportArgumentType]


def all_steps(job: Job, scene: Scene) -> dict[str, SplatfactoStep | ModelStep]:
    """By name, Splatfacto's first."""
    placed = 20 if job.quick else PER_VIEW
    return {
        SPLATFACTO: SplatfactoStep(scene, job.device),
        PLAIN: desplat_step(job, scene, None),
        NONE_PLACED: desplat_step(job, scene, 0),
        PLACED: desplat_step(job, scene, placed),
    }
