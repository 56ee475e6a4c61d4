"""One training step of the whole model on a generated scene, for timing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, replace
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.scene_box import SceneBox
from nerfstudio.engine.optimizers import Optimizers
from torch import nn

from desplat_ns.backend.protocol import View
from desplat_ns.backend.registry import BackendName
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import PARAMETER_NAMES, ViewDistractors, fill_view
from desplat_ns.model import DeSplatModel
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.settings.effects import Effects, EffectsConfig
from desplat_ns.training.optimizers import FusedAdamConfig
from lab.bench.scenes import Scene

LATE = 20_000
"""A step with all degrees of the harmonics, after densification."""


def cameras_of(scene: Scene, num_views: int) -> Cameras:
    """The scene's view, as every one of the training cameras."""
    view = scene.view
    to_world = torch.linalg.inv(view.viewmat)[:3] @ torch.diag(torch.tensor([1.0, -1, -1, 1]))
    return Cameras(
        to_world.repeat(num_views, 1, 1),
        float(view.K[0, 0]),
        float(view.K[1, 1]),
        float(view.K[0, 2]),
        float(view.K[1, 2]),
        view.width,
        view.height,
    )


class ModelStep:
    """A model, its optimizers, and one step of training of them all.

    Distractors are those of one view before any is placed, a view in which nothing is in the way,
    unless some are asked for. Learning rates are 0, so that every step has the same work to do.
    """

    def __init__(
        self,
        scene: Scene,
        effects: Effects,
        num_views: int = 8,
        device: str = "cpu",
        backend: BackendName = "numba",
        distractors_per_view: int = 0,
    ) -> None:
        """Args:
        scene: its Gaussians are the static ones, its view is that of every photo.
        backend: a rasterizer, or "auto".
        distractors_per_view: spread over every photo; only if `effects` has distractors.
        """
        cameras = cameras_of(scene, num_views).to(device)
        config = DeSplatModelConfig(
            effects=EffectsConfig(**asdict(effects)),
            distractors=DistractorConfig(start="residual", static_alone=True),
        )
        config.num_downscales, config.backend = 0, backend
        torch.manual_seed(0)
        self.model: DeSplatModel = config.setup(
            scene_box=SceneBox(torch.tensor([[-1.0] * 3, [1.0] * 3])),
            num_train_data=num_views,
            metadata={"train_cameras": cameras},
            seed_points=(
                scene.params["means"],
                torch.full(scene.params["means"].shape, 128, dtype=torch.uint8),
            ),
        )
        for name, value in scene.params.items():
            self.model.gauss_params[name].data = value.clone()
        if distractors_per_view > 0:
            self._spread_distractors(scene.view, distractors_per_view, range(num_views))
        if self.model.layer is not None:
            self.model.layer.rates_at = lambda _: dict.fromkeys(PARAMETER_NAMES, 0.0)
        self.model.to(device).train()
        self.model.step = LATE
        self.camera = cameras[:1]
        self.camera.metadata = {"train_idx": torch.tensor([[0]])}
        self.photo = torch.rand(scene.view.height, scene.view.width, 3).to(device)
        groups = {name: group for name, group in self.model.get_param_groups().items() if group}
        self.optimizers = self._optimizers_of(groups)
        self.model.optimizers = self.optimizers.optimizers

    def _optimizers_of(self, groups: dict[str, list[nn.Parameter]]) -> Optimizers:
        return Optimizers(self._options_of(groups), groups)

    def _options_of(self, groups: Iterable[str]) -> dict[str, Any]:
        """The package's Adam, which moves nothing."""
        adam = {"optimizer": FusedAdamConfig(lr=0.0, eps=1e-15), "scheduler": None}
        return dict.fromkeys(groups, adam)

    def _spread_distractors(self, view: View, per_view: int, views: Iterable[int]) -> None:
        """Give some views so many distractors, evenly over their photos."""
        distractors = self.model.distractors
        assert distractors is not None
        everywhere = replace(self.model.config.distractors, start="everywhere", per_view=per_view)
        for index in views:
            distractors.views[index] = ViewDistractors(fill_view(view, everywhere))

    def __call__(self) -> None:
        """Draw, weigh, pull back and step; nothing is densified."""
        self.optimizers.zero_grad_all()
        torch.stack(list(self.losses().values())).sum().backward()
        self.optimizers.optimizer_step_all()
        for optimizer in self.model.view_optimizers().values():
            optimizer.step()
        if self.photo.is_cuda:
            torch.cuda.synchronize()

    def losses(self) -> dict[str, torch.Tensor]:
        """The model's own, of the first photo."""
        return self.model.get_loss_dict(self.model(self.camera), {"image": self.photo})
