"""One training step of the whole model on a generated scene, for timing."""

from dataclasses import asdict, replace

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.scene_box import SceneBox
from nerfstudio.engine.optimizers import Optimizers

from desplat_ns.core.effects import Effects, EffectsConfig
from desplat_ns.core.optimizers import FusedAdamConfig
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.sets import ViewDistractors, fill_view
from desplat_ns.model import DeSplatModel
from desplat_ns.model_config import DeSplatModelConfig
from lab.bench.scenes import Scene

LATE = 20_000
"""A step with all degrees of the harmonics, after densification."""
NUM_VIEWS = 8


class ModelStep:
    """A model, its optimizers, and one step of training of them all, on the CPU.

    Learning rates are 0, so that every step has the same work to do.
    """

    def __init__(self, scene: Scene, effects: Effects, distractors_per_view: int = 0) -> None:
        """Args:
        scene: its Gaussians are the static ones, its view is that of every photo.
        distractors_per_view: spread over every photo; only if `effects` has distractors.
        """
        view = scene.view
        to_world = torch.linalg.inv(view.viewmat)[:3] @ torch.diag(torch.tensor([1.0, -1, -1, 1]))
        fx, fy, cx, cy = (float(view.K[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
        cameras = Cameras(to_world.repeat(NUM_VIEWS, 1, 1), fx, fy, cx, cy, view.width, view.height)
        config = DeSplatModelConfig(
            effects=EffectsConfig(**asdict(effects)),
            distractors=DistractorConfig(start="residual", static_alone=True),
        )
        config.num_downscales, config.backend = 0, "numba"
        torch.manual_seed(0)
        means = scene.params["means"]
        self.model: DeSplatModel = config.setup(
            scene_box=SceneBox(torch.tensor([[-1.0] * 3, [1.0] * 3])),
            num_train_data=NUM_VIEWS,
            metadata={"train_cameras": cameras},
            seed_points=(means, torch.full(means.shape, 128, dtype=torch.uint8)),
        )
        for name, value in scene.params.items():
            self.model.gauss_params[name].data = value.clone()
        if distractors_per_view > 0:
            assert self.model.distractors is not None
            spread = replace(config.distractors, start="everywhere", per_view=distractors_per_view)
            for index in range(NUM_VIEWS):
                self.model.distractors.views[index] = ViewDistractors(fill_view(view, spread))
        self.model.train()
        self.model.step = LATE
        self.camera = cameras[:1]
        self.camera.metadata = {"train_idx": torch.tensor([[0]])}
        self.photo = torch.rand(view.height, view.width, 3)
        groups = {name: group for name, group in self.model.get_param_groups().items() if group}
        adam = {"optimizer": FusedAdamConfig(lr=0.0, eps=1e-15), "scheduler": None}
        self.optimizers = Optimizers(dict.fromkeys(groups, adam), groups)
        self.model.optimizers = self.optimizers.optimizers

    def __call__(self) -> None:
        """Draw, weigh, pull back and step; nothing is densified."""
        self.optimizers.zero_grad_all()
        losses = self.model.get_loss_dict(self.model(self.camera), {"image": self.photo})
        torch.stack(list(losses.values())).sum().backward()
        self.optimizers.optimizer_step_all()
        for optimizer in self.model.view_optimizers().values():
            for group in optimizer.param_groups:
                group["lr"] = 0.0
            optimizer.step()
