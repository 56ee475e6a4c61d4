"""One training step of the whole model, with every number of photos: all show one random scene."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.scene_box import SceneBox
from nerfstudio.engine.optimizers import Optimizers

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.model import DeSplatModel, DeSplatModelConfig
from desplat_ns.settings.effects import Effects, EffectsConfig
from desplat_ns.training.optimizers import FusedAdamConfig

LATE = 20_000
"""A step with all degrees of the harmonics, after densification."""


def make_scene(count: int) -> dict[str, torch.Tensor]:
    """Raw parameters of `count` small Gaussians before a camera that looks along -z."""
    rng = torch.Generator().manual_seed(3)
    means = torch.rand(count, 3, generator=rng) - torch.tensor([0.5, 0.5, 3.0])
    return {
        "means": means,
        "quats": torch.randn(count, 4, generator=rng),
        "scales": torch.full((count, 3), -3.0),
        "opacities": torch.randn(count, 1, generator=rng),
        "features_dc": torch.randn(count, 3, generator=rng),
        "features_rest": 0.1 * torch.randn(count, 15, 3, generator=rng),
    }


class ModelStep:
    """A model, its optimizers, and one step of training of them all. Learning rates are 0, so that
    every step has the same work to do."""

    def __init__(self, scene: dict[str, torch.Tensor], effects: Effects, num_views: int) -> None:
        """Args:
        scene: the static Gaussians.
        num_views: training photos, all from one place, of 48 x 32 pixels.
        """
        pose = torch.eye(4)[:3].repeat(num_views, 1, 1)
        cameras = Cameras(pose, 40.0, 40.0, 24.0, 16.0, 48, 32)
        config = DeSplatModelConfig(
            effects=EffectsConfig(**asdict(effects)),
            distractors=DistractorConfig(start="residual", static_alone=True),
        )
        config.num_downscales, config.backend = 0, "torch"
        torch.manual_seed(0)
        self.model: DeSplatModel = config.setup(
            scene_box=SceneBox(torch.tensor([[-1.0] * 3, [1.0] * 3])),
            num_train_data=num_views,
            metadata={"train_cameras": cameras},
            seed_points=(scene["means"], torch.full_like(scene["means"], 128).byte()),
        )
        for name, value in scene.items():
            self.model.gauss_params[name].data = value.clone()
        self.model.train()
        self.model.step = LATE
        self.camera = cameras[:1]
        self.camera.metadata = {"train_idx": torch.tensor([[0]])}
        self.photo = torch.rand(32, 48, 3)
        groups = {name: group for name, group in self.model.get_param_groups().items() if group}
        still: dict[str, Any] = {"optimizer": FusedAdamConfig(lr=0.0), "scheduler": None}
        self.optimizers = Optimizers(dict.fromkeys(groups, still), groups)
        self.model.optimizers = self.optimizers.optimizers

    def __call__(self) -> None:
        """Draw, weigh, pull back and step; nothing is densified."""
        self.optimizers.zero_grad_all()
        losses = self.model.get_loss_dict(self.model(self.camera), {"image": self.photo})
        torch.stack(list(losses.values())).sum().backward()
        self.optimizers.optimizer_step_all()
        for optimizer in self.model.view_optimizers().values():
            optimizer.step()
