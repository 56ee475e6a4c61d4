"""A model of a few Gaussians, and the part of nerfstudio's training loop that touches it."""

from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.scene_box import SceneBox

from desplat_ns.core.effects import EffectsConfig
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.photo_tourism.config import AppearanceConfig

WIDTH, HEIGHT, NUM_VIEWS = 24, 20, 3


def cameras() -> Cameras:
    """Three cameras in a row that look at the origin from z = 3."""
    poses = torch.eye(4)[:3].repeat(NUM_VIEWS, 1, 1)
    poses[:, 2, 3] = 3.0
    poses[:, 0, 3] = torch.tensor([-0.2, 0.0, 0.2])
    return Cameras(poses, 20.0, 20.0, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)


def camera(train_idx: int | None = None, **metadata: Any) -> Cameras:
    single = cameras()[:1]
    if train_idx is not None:
        single = cameras()[train_idx : train_idx + 1]
        metadata["train_idx"] = torch.tensor([[train_idx]])
    single.metadata = metadata
    return single


def make_model(points: torch.Tensor | None = None, **config: Any) -> Any:
    """A DeSplatModel of `points`, or of 30 at random; as Any, its parts need no check for None."""
    torch.manual_seed(0)
    if points is None:
        points = torch.rand(30, 3) - 0.5
    config = {"num_downscales": 0, "backend": "numba", "background_color": "black"} | config
    config.setdefault("distractors", DistractorConfig(per_view=20))
    return DeSplatModelConfig(**config).setup(
        scene_box=SceneBox(torch.tensor([[-1.0] * 3, [1.0] * 3])),
        num_train_data=NUM_VIEWS,
        metadata={"train_cameras": cameras()},
        seed_points=(points, torch.full((len(points), 3), 128, dtype=torch.uint8)),
    )


def distractors_of(model: Any, view: int) -> dict[str, torch.nn.Parameter]:
    return model.distractors.views[view].params


def model_with(appearance: str = "off", background: str = "off", **config: Any) -> Any:
    """What its networks give counts in full, so that a few steps or small weights show."""
    config.setdefault("appearance", AppearanceConfig(mlp_scale=1.0))
    effects = EffectsConfig(appearance=appearance, background=background)  # type: ignore[arg-type]
    return make_model(effects=effects, **config)


def moved(model: Any) -> Any:
    """As if trained: embeddings that differ, heads that are not zero."""
    generator = torch.Generator().manual_seed(5)
    for parameter in model.image_effects.parameters():
        parameter.data += 0.2 * torch.randn(parameter.shape, generator=generator)
    return model


def held_out(width: int = WIDTH) -> Cameras:
    pose = torch.eye(4)[:3]
    pose[2, 3] = 3.0
    return Cameras(pose[None], 20.0, 20.0, WIDTH / 2, HEIGHT / 2, width, HEIGHT)


def photo_in_the_light_of(model: Any, view: int) -> torch.Tensor:
    with model.shown_light.fixed(model.image_effects.of(view)):
        return model.get_outputs_for_camera(held_out())["rgb"]


class Trainer:
    """The part of nerfstudio's training loop that touches the model."""

    def __init__(self, model: Any):
        self.model = model
        self.optimizers = {
            name: torch.optim.Adam(params, lr=1e-4 if "means" in name else 1e-2)
            for name, params in model.get_param_groups().items()
            if params
        }
        self.photo = torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(1))
        self.mask: torch.Tensor | None = None
        """The user's, [H, W, 1], nonzero in the pixels that count."""

    def step(self, step: int, view: int = 0) -> dict[str, Any]:
        model = self.model
        model.train()
        model.step, model.optimizers = step, self.optimizers
        for optimizer in self.optimizers.values():
            optimizer.zero_grad()
        outputs = model(camera(view))
        batch = {"image": self.photo} | ({} if self.mask is None else {"mask": self.mask})
        losses = model.get_loss_dict(outputs, batch)
        torch.stack(list(losses.values())).sum().backward()
        self.update()
        drawn = model.train_step
        model.step_post_backward(step)
        return {"outputs": outputs, "losses": losses, "step": drawn}

    def update(self) -> None:
        for optimizer in (*self.optimizers.values(), *self.model.view_optimizers().values()):
            optimizer.step()
