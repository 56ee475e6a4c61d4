"""Saves and restores what a run needs, besides the model, to go on as if it had never stopped.

Moments and learning rates of the optimizers, positions on the schedules, random generators.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from nerfstudio.engine.optimizers import Optimizers
from torch import Tensor
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR

from desplat_ns.errors import CheckpointError
from desplat_ns.training.schedules import set_position


def rng_state() -> dict[str, Any]:
    """State of the random generators of torch (CPU, and every GPU if one is in use), numpy, Python.

    Tensors and plain Python values only, so that `torch.load(weights_only=True)` reads it.
    """
    kind, keys, position, has_gauss, cached_gaussian = np.random.get_state()
    version, internal, gauss_next = random.getstate()
    return {
        "torch": torch.get_rng_state(),
        "cuda": torch.cuda.get_rng_state_all() if torch.cuda.is_initialized() else [],
        "numpy": {
            "kind": str(kind),
            "keys": torch.from_numpy(np.asarray(keys, dtype=np.int64)),
            "position": int(position),
            "has_gauss": int(has_gauss),
            "cached_gaussian": float(cached_gaussian),
        },
        "python": (version, tuple(internal), gauss_next),
    }


def restore_rng(state: Mapping[str, Any]) -> None:
    """Restore the generators to what `rng_state` gave. GPUs that are not here are left out."""
    torch.set_rng_state(state["torch"])
    if torch.cuda.is_available():
        for device, generator in zip(range(torch.cuda.device_count()), state["cuda"], strict=False):
            torch.cuda.set_rng_state(generator, device)
    saved = state["numpy"]
    keys = saved["keys"].numpy().astype(np.uint32)
    np.random.set_state(
        (saved["kind"], keys, saved["position"], saved["has_gauss"], saved["cached_gaussian"])
    )
    version, internal, gauss_next = state["python"]
    random.setstate((version, tuple(internal), gauss_next))


def load_optimizers(optimizers: Optimizers, saved: Mapping[str, Any], source: Path) -> None:
    """Bring back the optimizers' moments from the checkpoint `source`.

    Rates, epsilons and the like stay those of this run's options, except a rate that only the
    scheduler's history gives. The parameters must have their saved shapes already.
    Raises CheckpointError, before anything is changed, where groups or shapes do not match.
    """
    _check_groups(optimizers, saved, source)
    for name, optimizer in optimizers.optimizers.items():
        _check_shapes(name, optimizer, saved[name], source)
    for name, optimizer in optimizers.optimizers.items():
        scheduler = optimizers.schedulers.get(name)
        kept = (
            {"params"} if scheduler is None or isinstance(scheduler, LambdaLR) else {"params", "lr"}
        )
        options = [
            {key: value for key, value in group.items() if key not in kept}
            for group in optimizer.param_groups
        ]
        optimizer.load_state_dict(saved[name])
        for group, own in zip(optimizer.param_groups, options, strict=True):
            group.update(own)


def load_schedulers(optimizers: Optimizers, saved: Mapping[str, Any], steps_done: int) -> None:
    """Set each schedule to where it is after `steps_done`.

    The curve is this run's: continued with a larger number of steps, the learning rate is the one
    that the longer schedule has at that position.
    """
    for name, scheduler in optimizers.schedulers.items():
        if isinstance(scheduler, LambdaLR):
            set_position(scheduler, steps_done)
        elif name in saved:
            scheduler.load_state_dict(saved[name])


def _check_groups(optimizers: Optimizers, saved: Mapping[str, Any], source: Path) -> None:
    lacking = sorted(set(optimizers.optimizers) - set(saved))
    unknown = sorted(set(saved) - set(optimizers.optimizers))
    if not lacking and not unknown:
        return
    differences = [f"no optimizer state for {', '.join(lacking)}"] if lacking else []
    differences += (
        [f"state for {', '.join(unknown)}, which this run does not train"] if unknown else []
    )
    raise CheckpointError(
        f"The checkpoint {source} was trained with other effects: it has "
        f"{' and '.join(differences)}. "
        "Switch on the same --pipeline.model.effects as in that run's config.yml."
    )


def _check_shapes(name: str, optimizer: Optimizer, saved: Mapping[str, Any], source: Path) -> None:
    """torch loads moments of any shape and fails steps later; refuse them at once instead."""
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    keys = [key for group in saved["param_groups"] for key in group["params"]]
    if len(keys) != len(parameters):
        raise CheckpointError(
            f"The checkpoint {source} has {len(keys)} tensors in the group '{name}', this run has "
            f"{len(parameters)}. Load it with the scene and the effects it was trained with."
        )
    for key, parameter in zip(keys, parameters, strict=True):
        for moment, value in saved["state"].get(key, {}).items():
            is_moment = isinstance(value, Tensor) and value.ndim > 0
            if is_moment and value.shape != parameter.shape:
                raise CheckpointError(
                    f"The checkpoint {source} has {moment} of shape {tuple(value.shape)} in the "
                    f"group '{name}', its parameter has {tuple(parameter.shape)}: the file does "
                    "not fit itself or this scene. Give another one with `--load-checkpoint FILE`."
                )
