"""Options under poison: what follows from them is finite, or an error names the option."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.engine.optimizers import AdamOptimizerConfig, Optimizers
from nerfstudio.engine.schedulers import ExponentialDecaySchedulerConfig
from nerfstudio.utils.rich_utils import CONSOLE

from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.errors import DeSplatError
from desplat_ns.evaluation.config import EvaluationConfig, chosen_protocol
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import DistractorGaussians
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.photo_tourism.dataparser import PhotoTourismDataParserConfig
from desplat_ns.photo_tourism.image_effects import ImageEffects
from desplat_ns.photo_tourism.split_file import draw_split
from desplat_ns.settings.effects import Effects
from desplat_ns.settings.options import check_finite_options
from desplat_ns.training.budget import Clock
from desplat_ns.training.schedules import checked_schedules, follow
from lab.stability.fuzz_files import FAULT, FINE, REFUSED, numbers_of, tensors_of
from tests.stability.poison import POISON

NUMBERS = (*POISON, -5.0, 1e12)
MOST_ROWS = 10**3
"""Larger counts are valid, and take their time and memory: they are not tried."""


@dataclass(frozen=True)
class Options:
    """One dataclass of options, and what is made of it."""

    name: str
    config: Any
    use: Callable[[Any], Any]
    """Numbers that follow; raises DeSplatError."""


def poisoned(rng: random.Random, config: Any) -> Any:
    """A copy with one number replaced by another of its type."""
    changed = copy.deepcopy(config)
    kinds = {f.name: type(getattr(config, f.name)) for f in fields(config)}
    name = rng.choice(sorted(n for n, kind in kinds.items() if kind in (int, float)))
    value = rng.choice(NUMBERS)
    if kinds[name] is int:
        value = int(value) if math.isfinite(value) and abs(value) < MOST_ROWS else -1
    setattr(changed, name, value)
    return changed


def fate_of(options: Options, rng: random.Random) -> str:
    """What became of one poisoned number; a fault is returned as its description."""
    config = poisoned(rng, options.config)
    try:
        with CONSOLE.capture():
            check_finite_options(config)
            outcome = options.use(config)
    except DeSplatError as error:
        return REFUSED if "--" in str(error) or "needs" in str(error) else f"{FAULT}: {error}"
    except Exception as error:
        return f"{FAULT}: {options.name}: {type(error).__name__}: {error}: {config}"
    if all(bool(t.isfinite().all()) for t in tensors_of(outcome)):
        return FINE
    return f"{FAULT}: {options.name}: taken, and not finite: {config}"


def _cameras() -> Cameras:
    pose = torch.eye(4)[:3].repeat(2, 1, 1)
    return Cameras(pose, fx=20.0, fy=20.0, cx=7.0, cy=6.0, width=15, height=13)


def _distractors(config: DistractorConfig) -> Any:
    made = DistractorGaussians(config, _cameras())
    return [p.detach() for group in made.param_groups().values() for p in group]


def _run(config: Any) -> Any:
    trainer = config.setup()
    model = trainer.config.pipeline.model
    return [model.schedule_scale, float(model.for_run(3).refine_every)]


def _decay(config: ExponentialDecaySchedulerConfig) -> Any:
    group = {"optimizer": AdamOptimizerConfig(lr=1e-2), "scheduler": config}
    parameter = torch.nn.Parameter(torch.zeros(1))
    optimizers = Optimizers(checked_schedules({"means": group}), {"means": [parameter]})
    optimizer, scheduler = optimizers.optimizers["means"], optimizers.schedulers["means"]
    follow(scheduler, Clock(0.1))
    rates = []
    for _ in range(5):
        optimizer.step()
        scheduler.step()
        rates.append(float(optimizer.param_groups[0]["lr"]))
    return rates


def _drawn(config: PhotoTourismDataParserConfig) -> Any:
    assert config.test_fraction is not None
    split = draw_split([f"{i}.png" for i in range(9)], config.test_fraction, config.seed)
    assert split.train and split.test
    return []


def _halves(config: EvaluationConfig) -> Any:
    chosen_protocol(config, image_light=True)
    return [float(config.steps), config.learning_rate]


def _effects(appearance: AppearanceConfig, background: BackgroundConfig) -> Any:
    both = Effects(appearance="affine", background="image")
    made = ImageEffects(both, appearance, background, 3, 2)
    return [p.detach() for p in made.parameters()]


def all_options(capture: Path, output: Path) -> tuple[Options, ...]:
    """Everything that is tried; `capture` is a generated one."""
    run: Any = copy.deepcopy(all_methods["desplat"])
    run.output_dir, run.vis, run.experiment_name = output, "tensorboard", "x"
    background = BackgroundConfig()
    return (
        Options("the run", run, _run),
        Options("distractors", DistractorConfig(per_view=9), _distractors),
        Options("learning rates", ExponentialDecaySchedulerConfig(lr_final=1e-3), _decay),
        Options(
            "captures",
            RobustNerfDataParserConfig(data=capture),
            lambda config: numbers_of(config.setup().get_dataparser_outputs()),
        ),
        Options("splits", PhotoTourismDataParserConfig(test_fraction=0.3), _drawn),
        Options("evaluation", EvaluationConfig(), _halves),
        Options("appearance", AppearanceConfig(), lambda config: _effects(config, background)),
        Options("background", background, lambda config: _effects(AppearanceConfig(), config)),
    )
