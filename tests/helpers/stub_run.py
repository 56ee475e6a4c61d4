"""A run of the trainer on a stub of a pipeline, and equality to the last bit."""

import dataclasses
import random
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from nerfstudio.configs.base_config import LocalWriterConfig, LoggingConfig, MachineConfig
from nerfstudio.engine.optimizers import AdamOptimizerConfig
from nerfstudio.engine.schedulers import ExponentialDecaySchedulerConfig
from nerfstudio.pipelines.base_pipeline import Pipeline, VanillaPipelineConfig
from nerfstudio.utils import writer
from torch.nn import Parameter
from torch.utils._pytree import keystr, tree_flatten_with_path

from desplat_ns.core.effects import EffectsConfig
from desplat_ns.core.options import ranged
from desplat_ns.core.schedule import Schedule
from desplat_ns.training.trainer import DeSplatTrainerConfig
from tests.helpers import registered


class StubDatamanager:
    """Draws training views without replacement, as the real one does."""

    def __init__(self) -> None:
        self.train_dataset = [0, 1, 2, 3, 4]
        self.train_image_names = [f"{number}.png" for number in self.train_dataset]
        self.eval_dataset = None
        self.left: list[int] = []

    def next_view(self) -> int:
        self.left = self.left or list(self.train_dataset)
        return self.left.pop(random.randrange(len(self.left)))

    def sampler_state(self) -> dict[str, Any]:
        return {"left": list(self.left)}

    def load_sampler_state(self, state: dict[str, Any]) -> None:
        self.left = list(state["left"])

    def get_train_rays_per_batch(self) -> int:
        return 1


class StubModel:
    """What the trainer asks of a model: one photo, nothing to forget."""

    def __init__(self, scale: float | None = None) -> None:
        self.schedule = Schedule(scale or 1.0)
        self.step = 0
        self.gauss_params = {"means": torch.zeros(1, 3)}
        self.names = ["a.jpg"]

    def view_optimizers(self) -> dict[str, torch.optim.Optimizer]:
        return {}

    def found_in_the_way(self) -> list[str]:
        return []


class StubPipeline(Pipeline):
    """Two groups of parameters whose loss depends on every random generator."""

    def __init__(self, config: "StubPipelineConfig", **_: Any) -> None:
        super().__init__()
        groups = {name: Parameter(torch.ones(4)) for name in ("means", "scales")}
        self.groups = torch.nn.ParameterDict(groups)
        self.datamanager: Any = StubDatamanager()
        self._model: Any = StubModel(config.model.schedule_scale)
        self.at_step: Callable[[int], None] = lambda step: None
        self.trained: list[int] = []

    @property
    def device(self) -> Any:
        return "cpu"

    def get_train_loss_dict(self, step: int) -> Any:
        self._model.step, self._model.train_step = step, SimpleNamespace(losses={}, index=0)
        self.at_step(step)
        self.trained.append(step)
        target = torch.rand(4) + self.datamanager.next_view()
        losses = [((p - target) ** 2).mean() for p in self.groups.values()]
        return {}, {"loss": torch.stack(losses).sum()}, {}

    def get_param_groups(self) -> dict[str, list[Parameter]]:
        return {name: [parameter] for name, parameter in self.groups.items()}

    def load_pipeline(self, loaded_state: dict[str, Any], step: int) -> None:
        torch.nn.Module.load_state_dict(self, loaded_state)

    def get_training_callbacks(self, training_callback_attributes: Any) -> list[Any]:
        return []

    def static_scene(self) -> Any:
        return nullcontext()

    def get_eval_image_metrics_and_images(self, step: int) -> Any:
        draws = torch.rand(3).sum().item() + random.random()
        return {"num_rays": 1, "draws": draws}, {}

    get_eval_loss_dict = get_train_loss_dict

    def get_average_eval_image_metrics(
        self, step: int | None = None, output_path: Path | None = None, get_std: bool = False
    ) -> Any:
        return {}


@dataclass
class StubModelConfig:
    """What the trainer settles of the model's configuration, and what it has compiled for it."""

    schedule_scale: float | None = ranged(None, "(0, inf)")
    backend: str = "torch"
    warmup: tuple[int, int] = (0, 0)
    effects = EffectsConfig()

    def warmup_of(self, num_views: int) -> tuple[int, int]:
        return self.warmup


@dataclass
class StubPipelineConfig(VanillaPipelineConfig):
    """Configures a StubPipeline."""

    _target: type = field(default_factory=lambda: StubPipeline)
    datamanager: Any = field(default_factory=lambda: SimpleNamespace(data=None))
    model: Any = field(default_factory=StubModelConfig)


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> DeSplatTrainerConfig:
    monkeypatch.setattr(writer, "EVENT_WRITERS", [])  # nerfstudio keeps them for the process
    constant = {"optimizer": AdamOptimizerConfig(lr=1e-2), "scheduler": None}
    decay = {**constant, "scheduler": ExponentialDecaySchedulerConfig(lr_final=1e-4, max_steps=24)}
    return DeSplatTrainerConfig(
        method_name="stub",
        output_dir=tmp_path,
        timestamp="first",
        machine=MachineConfig(device_type="cpu"),
        logging=LoggingConfig(local_writer=LocalWriterConfig(enable=False)),
        pipeline=StubPipelineConfig(),
        accept_mismatch=True,  # there is no capture to look at
        optimizers={"means": decay, "scales": constant, "extra": constant},
        vis="tensorboard",
        nominal_num_iterations=24,
        max_num_iterations=12,
        steps_per_save=5,
        save_only_latest_checkpoint=False,
    )


def set_up(config: DeSplatTrainerConfig, seed: int = 1) -> Any:
    """A DeSplatTrainer with its StubPipeline, ready to train.

    The checks of types in tests draw from Python's generator, too: runs are the same to the last
    bit with seeds after which that changes no view that is drawn.
    """
    return registered.set_up(config, seed)


def train(config: DeSplatTrainerConfig, seed: int = 1) -> Any:
    trainer = set_up(config, seed)
    trainer.train()
    return trainer


def resumed(config: DeSplatTrainerConfig, **changes: Any) -> DeSplatTrainerConfig:
    """The configuration of a new run that goes on from this one's."""
    changes = {"timestamp": "second", "load_dir": config.get_checkpoint_dir(), **changes}
    return dataclasses.replace(config, pipeline=StubPipelineConfig(), **changes)


def assert_same(a: Any, b: Any) -> None:
    """Equality to the last bit, all the way down."""
    (ours, tree), (theirs, other) = tree_flatten_with_path(a), tree_flatten_with_path(b)
    assert tree == other
    for (where, left), (_, right) in zip(ours, theirs, strict=True):
        assert type(left) is type(right), keystr(where)
        is_same = torch.equal(left, right) if isinstance(left, torch.Tensor) else left == right
        assert is_same, keystr(where)
