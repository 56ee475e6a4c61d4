"""A pipeline around a small model, whose evaluation photos are brighter than what it renders."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import nn

from desplat_ns.pipeline import DeSplatPipeline, DeSplatPipelineConfig
from desplat_ns.settings.effects import EffectsConfig
from tests.helpers import small_model


@dataclass
class KnownManager:
    """The part of a datamanager that a pipeline asks for; photos are 0.1, 0.2, ... brighter."""

    num_eval: int = 2
    train_image_names: list[str] = field(default_factory=lambda: ["a.png", "b.png", "c.png"])
    masks: list[Path] = field(default_factory=list)
    """Of the first training views."""
    device: str = "cpu"
    train_dataset: Any = field(default_factory=lambda: SimpleNamespace(cameras=numbered()))
    shown: Any = None
    """What the model renders of a held-out photo."""

    def gt_masks(self) -> list[tuple[Cameras, Path]]:
        return [(numbered()[i : i + 1], path) for i, path in enumerate(self.masks)]

    @property
    def eval_dataset(self) -> SimpleNamespace:
        names = [Path(f"/capture/images/extra_{i}.png") for i in range(self.num_eval)]
        return SimpleNamespace(image_filenames=names)

    @property
    def fixed_indices_eval_dataloader(self) -> list[tuple[Cameras, dict]]:
        photos = (self.shown + 0.1 * (i + 1) for i in range(self.num_eval))
        batches = ({"image": photo, "image_idx": i} for i, photo in enumerate(photos))
        return [(small_model.held_out(), batch) for batch in batches]

    def next_eval(self, step: int) -> tuple[Cameras, dict]:
        return self.fixed_indices_eval_dataloader[0]

    next_eval_image = next_eval


def numbered() -> Cameras:
    """The training cameras with the numbers of their views."""
    cameras = small_model.cameras()
    cameras.metadata = {"train_idx": torch.arange(small_model.NUM_VIEWS)[:, None]}
    return cameras


def known_pipeline(manager: KnownManager | None = None, distractors: bool = True) -> Any:
    """A pipeline that needs no capture."""
    pipeline = DeSplatPipeline.__new__(DeSplatPipeline)
    nn.Module.__init__(pipeline)
    parts: Any = pipeline
    parts.config, parts.datamanager = DeSplatPipelineConfig(), manager or KnownManager()
    parts._model = model = small_model.make_model(effects=EffectsConfig(distractors=distractors))
    parts.datamanager.shown = model.eval().get_outputs_for_camera(small_model.held_out())["rgb"]
    model.train()
    return pipeline
