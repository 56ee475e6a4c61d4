"""What a checkpoint holds so that a run goes on as if it had never stopped, besides the model and
the optimizers: the scene that it belongs to, and the random generators."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch

from desplat_ns.errors import CheckpointError

FORMAT = 2
"""Version of `SceneRecord`, raised whenever checkpoints are no longer those of before."""


@dataclass(frozen=True)
class SceneRecord:
    """What a checkpoint was trained with; a checkpoint holds it as a dictionary of plain values,
    which `torch.load(weights_only=True)` reads."""

    effects: dict[str, Any]
    """The switches in `pipeline.model.effects`."""
    sh_degree: int
    """Spherical-harmonics degree of the static Gaussians."""
    train_images: list[str]
    """Names of the training photos, in the order of the training views; empty where unknown."""
    format: int = FORMAT

    @classmethod
    def from_state(cls, state: object) -> SceneRecord:
        """Read a record back.

        Raises CheckpointError where there is none, or one that this version cannot read.
        """
        if not isinstance(state, Mapping) or "format" not in state:
            raise CheckpointError(
                "The checkpoint holds no record of its scene, so it was not saved by `desplat`. "
                "Pass a `desplat` run's folder `.../desplat/<timestamp>/nerfstudio_models` to "
                "`--load-dir`."
            )
        names = {field.name for field in fields(cls)}
        if state["format"] != FORMAT or not names <= set(state):
            raise CheckpointError(
                f"The checkpoint has format {state['format']}, this desplat-ns reads format "
                f"{FORMAT} alone: another version saved it. Use that version, or train anew."
            )
        return cls(**{name: state[name] for name in names})

    def check_fits(self, here: SceneRecord) -> None:
        """Raise CheckpointError, saying what differs, unless this can be loaded into `here`."""
        options = [
            (f"effects.{name.replace('_', '-')}", self.effects.get(name), value)
            for name, value in sorted(here.effects.items())
        ]
        options.append(("sh-degree", self.sh_degree, here.sh_degree))
        differing = [(name, was, now) for name, was, now in options if was != now]
        if differing:
            trained = ", ".join(f"{name} {was} (here {now})" for name, was, now in differing)
            switches = " ".join(f"--pipeline.model.{name} {was}" for name, was, _ in differing)
            raise CheckpointError(f"The checkpoint was trained with {trained}. Add `{switches}`.")
        theirs, ours = self.train_images, here.train_images
        if not theirs or not ours or theirs == ours:
            return
        different = sorted({*theirs} ^ {*ours}, key=lambda name: (name in ours, name))
        what = "the same photos in another order; views would get each other's distractors"
        if different:
            side = "the checkpoint" if different[0] in theirs else "this run"
            what = (
                f"another scene or split: {len(theirs)} photos, this run has {len(ours)}; "
                f"'{different[0]}' is a photo of {side} alone"
            )
        raise CheckpointError(
            f"The checkpoint was trained on {what}. Pass the `--data` and the split options that "
            "it was trained with, or drop `--load-dir` to train from the start."
        )


def rng_state() -> dict[str, Any]:
    """State of the random generators of torch (CPU, and every GPU if one is in use), numpy, Python.

    Tensors and plain Python values only, so that `torch.load(weights_only=True)` reads it.
    """
    numpy: Any = np.random.get_state(legacy=False)
    numpy["state"]["key"] = torch.from_numpy(numpy["state"]["key"].astype(np.int64))
    return {
        "torch": torch.get_rng_state(),
        "cuda": torch.cuda.get_rng_state_all() if torch.cuda.is_initialized() else [],
        "numpy": numpy,
        "python": random.getstate(),
    }


def restore_rng(state: Mapping[str, Any]) -> None:
    """Restore the generators to what `rng_state` gave. GPUs that are not here are left out."""
    torch.set_rng_state(state["torch"])
    if torch.cuda.is_available():
        for device, generator in zip(range(torch.cuda.device_count()), state["cuda"], strict=False):
            torch.cuda.set_rng_state(generator, device)
    numpy = state["numpy"]
    key = numpy["state"]["key"].numpy().astype(np.uint32)
    np.random.set_state({**numpy, "state": {**numpy["state"], "key": key}})
    random.setstate(state["python"])
