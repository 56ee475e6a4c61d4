"""Saves and restores what a run needs, besides the model, to go on as if it had never stopped.

Moments of the optimizers, positions on the schedules, random generators.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from nerfstudio.engine.optimizers import Optimizers
from torch.optim.lr_scheduler import LambdaLR

from desplat_ns.errors import CheckpointError
from desplat_ns.training.optimizers import set_position


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
    scheduler's history gives. The parameters must have their saved shapes already: the pipeline is
    loaded first. Raises CheckpointError, before anything is changed, where groups do not match.
    """
    here, there = set(optimizers.optimizers), set(saved)
    if here != there:
        raise CheckpointError(
            f"The checkpoint {source} was trained with other effects: it alone has "
            f"{', '.join(sorted(there - here)) or 'nothing'}, this run alone "
            f"{', '.join(sorted(here - there)) or 'nothing'}. Switch on the same "
            "--pipeline.model.effects as in that run's config.yml."
        )
    for name, optimizer in optimizers.optimizers.items():
        scheduler = optimizers.schedulers.get(name)
        from_saved = {"params"}
        if scheduler is not None and not isinstance(scheduler, LambdaLR):
            from_saved.add("lr")
        options = [
            {key: value for key, value in group.items() if key not in from_saved}
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
