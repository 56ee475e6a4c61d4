"""A pipeline around a model whose every answer is known."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import nn

from desplat_ns.gaussians.distractors import DistractorGaussians, ViewDistractors
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.photo_tourism.image_effects import ImageEffects
from desplat_ns.photo_tourism.shown_light import ShownLight
from desplat_ns.pipeline import DeSplatPipeline, DeSplatPipelineConfig
from desplat_ns.rendering.metrics import LazyLpips, image_metrics
from desplat_ns.settings.effects import Effects
from desplat_ns.viewer import LayerControl

HEIGHT, WIDTH = 16, 20


class NoLpips(LazyLpips):
    def __init__(self) -> None:
        super().__init__()
        self.reason = "no weights in this test"


class KnownDistractors(DistractorGaussians):
    """Of two views, 2 and 3."""

    def __init__(self) -> None:
        nn.Module.__init__(self)
        self.views = [ViewDistractors({"means": torch.zeros(n, 3)}) for n in (2, 3)]


class KnownModel(DeSplatModel):
    """Renders a plain picture: grey 0.5 and, if an open viewer asks for distractors, white."""

    rasterizer: Any = SimpleNamespace(name="torch")
    device: Any = torch.device("cpu")
    get_extra_state, set_extra_state = nn.Module.get_extra_state, nn.Module.set_extra_state
    _load_from_state_dict: Any = nn.Module._load_from_state_dict

    def __init__(self, effects: Effects, points: int = 4) -> None:
        nn.Module.__init__(self)
        self.config: Any
        self.config, self.effects = SimpleNamespace(sh_degree=3), effects
        self.image_effects = ImageEffects(Effects(), AppearanceConfig(), BackgroundConfig(), 1, 3)
        self.gauss_params = nn.ParameterDict({"means": torch.zeros(points, 3)})
        self.distractors = KnownDistractors() if effects.distractors else None
        self.layer_control = LayerControl(["0.jpg", "1.jpg"] if effects.distractors else [])
        self.shown_light = ShownLight([])
        self.lpips = NoLpips()
        self.step, self.renders, self.value = 0, 0, 0.5
        self.covered = 0  # columns, from the left, that distractors cover

    def get_outputs_for_camera(self, camera: Cameras) -> dict[str, torch.Tensor]:
        self.renders += 1
        grey = 1.0 if self.layer_control.train_idx() is not None else self.value
        alpha = torch.zeros(HEIGHT, WIDTH, 1)
        alpha[:, : self.covered] = 0.75
        rgb = torch.full((HEIGHT, WIDTH, 3), grey)
        return {"rgb": rgb, "alpha_distractor": alpha, "distractor_mask": alpha > 0.5}

    forward: Any = get_outputs_for_camera

    def get_image_metrics_and_images(self, outputs: dict, batch: dict) -> tuple[dict, dict]:
        figures = image_metrics(outputs["rgb"], batch["image"], self.lpips)
        return figures, {"img": torch.cat([batch["image"], outputs["rgb"]], dim=1)}

    def get_metrics_dict(self, outputs: dict, batch: dict) -> dict:
        return {"psnr": image_metrics(outputs["rgb"], batch["image"])["psnr"]}

    def get_loss_dict(self, outputs: dict, batch: dict, metrics: dict) -> dict:
        return {}


def known_cameras(n: int) -> Cameras:
    """All in one place, with the numbers 0, 1, ... of training photos."""
    return Cameras(
        camera_to_worlds=torch.eye(4)[None, :3].repeat(n, 1, 1),
        fx=20.0,
        fy=20.0,
        cx=WIDTH / 2,
        cy=HEIGHT / 2,
        width=WIDTH,
        height=HEIGHT,
        metadata={"train_idx": torch.arange(n)[:, None]},
    )


@dataclass
class KnownManager:
    """Evaluation photos that are 0.1, 0.2, ... brighter than what the model renders."""

    num_eval: int = 2
    train_image_names: list[str] = field(default_factory=lambda: ["a.png", "b.png"])
    masks: list[Path | None] = field(default_factory=list)
    device: str = "cpu"

    def gt_masks(self) -> list[tuple[Cameras, Path]]:
        cameras = known_cameras(len(self.masks))
        return [(cameras[i : i + 1], p) for i, p in enumerate(self.masks) if p is not None]

    @property
    def fixed_indices_eval_dataloader(self) -> list[tuple[Cameras, dict]]:
        cameras = known_cameras(self.num_eval)
        return [(cameras[i : i + 1], self._batch(i)) for i in range(self.num_eval)]

    def _batch(self, index: int) -> dict:
        photo = torch.full((HEIGHT, WIDTH, 3), 0.5 + 0.1 * (index + 1))
        return {"image": photo, "image_idx": index}

    def next_eval_image(self, step: int) -> tuple[Cameras, dict]:
        return self.fixed_indices_eval_dataloader[0]

    next_eval = next_eval_image

    @property
    def eval_dataset(self) -> SimpleNamespace:
        names = [Path(f"/capture/images/extra_{i}.png") for i in range(self.num_eval)]
        return SimpleNamespace(image_filenames=names)

    @property
    def train_dataset(self) -> SimpleNamespace:
        return SimpleNamespace(cameras=known_cameras(len(self.train_image_names)))


def known_pipeline(
    manager: KnownManager | None = None, distractors: bool = True, points: int = 4
) -> DeSplatPipeline:
    """A pipeline that needs no capture, around `KnownModel`."""
    pipeline = DeSplatPipeline.__new__(DeSplatPipeline)
    nn.Module.__init__(pipeline)
    parts: Any = pipeline
    parts.config = DeSplatPipelineConfig()
    parts.datamanager = manager or KnownManager()
    parts._model = KnownModel(Effects(distractors=distractors), points)
    return pipeline


def model_of(pipeline: DeSplatPipeline) -> Any:
    """The `KnownModel` in it."""
    return pipeline.model
