"""What a checkpoint holds so that a run goes on as if it had never stopped, besides the model and
the optimizers: the scene that it belongs to, and the random generators."""

import random
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor

from desplat_ns.core.errors import CheckpointError

POSE_TOLERANCE = 1e-4
"""Of the scene's size: a tenth of a pixel in a photo of 1000. Processors round by less."""


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
    cameras: dict[str, Tensor] | None = None
    """Of the training views, see `DeSplatDataManager.remembered`; None in older checkpoints."""

    @classmethod
    def from_state(cls, state: object) -> "SceneRecord":
        """Read a record back. Raises CheckpointError where this version can read none."""
        names = {field.name for field in fields(cls)}
        if not isinstance(state, Mapping) or {*state, "cameras"} != names:
            raise CheckpointError(
                "The checkpoint holds no record of its scene that this version reads: another "
                "method or another version of desplat-ns saved it. Use that one, or train anew."
            )
        return cls(**state)

    def check_fits(self, here: "SceneRecord") -> None:
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
        if theirs and ours and theirs != ours:
            different = sorted({*theirs} ^ {*ours})
            what = f"other photos, such as '{different[0]}'" if different else "another order"
            raise CheckpointError(
                f"The checkpoint was trained on {len(theirs)} photos, this run has {len(ours)}: "
                f"{what}. Pass the `--data` and the split options that it was trained with."
            )
        if not (self.cameras and here.cameras):
            return
        was, now = (each["camera_to_worlds"].cpu() for each in (self.cameras, here.cameras))
        off = (was - now).abs().amax(dim=(1, 2)) / was[..., 3].abs().max().clamp(min=1)
        if off.max() > POSE_TOLERANCE:
            raise CheckpointError(
                f"{int((off > POSE_TOLERANCE).sum())} of {len(off)} photos have other poses than "
                f"in training, {theirs[int(off.argmax())]} by {float(off.max()):.2g} of the "
                "scene's size: the reconstruction was made anew, photos were added to it or taken "
                "out, or options of the data parser differ. Put the old ones back, or train anew."
            )


def rng_state() -> dict[str, Any]:
    """State of the random generators of torch (CPU, and every GPU if one is in use) and Python, as
    `torch.load(weights_only=True)` reads it; nothing in training draws from numpy's."""
    return {
        "torch": torch.get_rng_state(),
        "cuda": torch.cuda.get_rng_state_all() if torch.cuda.is_initialized() else [],
        "python": random.getstate(),
    }


@contextmanager
def rng_kept() -> Iterator[None]:
    """Around what draws from the generators, and must not change what training draws."""
    state = rng_state()
    try:
        yield
    finally:
        restore_rng(state)


def restore_rng(state: Mapping[str, Any]) -> None:
    """Restore the generators to what `rng_state` gave. GPUs that are not here are left out."""
    torch.set_rng_state(state["torch"])
    torch.cuda.set_rng_state_all(state["cuda"][: torch.cuda.device_count()])
    random.setstate(state["python"])
