"""The record of effects and photos in a checkpoint, compared before anything is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from desplat_ns.errors import CheckpointError

FORMAT = 1
"""Version of the record, raised whenever checkpoints are no longer those of before."""


@dataclass(frozen=True)
class SceneRecord:
    """What a checkpoint was trained with, in plain values: `torch.load(weights_only=True)` reads
    them."""

    effects: dict[str, Any]
    """The switches in `pipeline.model.effects`."""
    sh_degree: int
    """Spherical-harmonics degree of the static Gaussians."""
    train_images: list[str]
    """Names of the training photos, in the order of the training views; empty where unknown."""
    format: int = FORMAT

    def to_state(self) -> dict[str, Any]:
        """The record as it stands in the checkpoint."""
        return asdict(self)

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


def check_same_scene(saved: SceneRecord, here: SceneRecord) -> None:
    """Raise CheckpointError, saying what differs, unless `saved` can be loaded into `here`."""
    options = [
        (f"effects.{name.replace('_', '-')}", saved.effects.get(name), value)
        for name, value in sorted(here.effects.items())
    ]
    options.append(("sh-degree", saved.sh_degree, here.sh_degree))
    differing = [(name, was, now) for name, was, now in options if was != now]
    if differing:
        trained = ", ".join(f"{name} {was} (here {now})" for name, was, now in differing)
        switches = " ".join(f"--pipeline.model.{name} {was}" for name, was, _ in differing)
        raise CheckpointError(f"The checkpoint was trained with {trained}. Add `{switches}`.")
    if saved.train_images and here.train_images and saved.train_images != here.train_images:
        raise CheckpointError(
            f"The checkpoint {_difference(saved.train_images, here.train_images)}. Pass the "
            "`--data` and the split options that it was trained with, or drop `--load-dir` to "
            "train from the start."
        )


def _difference(saved: list[str], here: list[str]) -> str:
    only_saved, only_here = sorted({*saved} - {*here}), sorted({*here} - {*saved})
    if not only_saved and not only_here:
        return (
            "was trained on the same photos in another order, and each view's distractors would "
            "land in another view"
        )
    example = only_saved[0] if only_saved else only_here[0]
    side = "the checkpoint" if only_saved else "this run"
    return (
        f"belongs to another scene or split: it was trained on {len(saved)} photos, this run has "
        f"{len(here)}; '{example}' is a photo of {side} alone"
    )
