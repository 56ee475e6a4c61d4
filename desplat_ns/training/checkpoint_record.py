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
    """Which effects and photos a checkpoint was trained with.

    Plain values only, so that `torch.load(weights_only=True)` reads them."""

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
                "Needed: a checkpoint of a `desplat` run. Pass that run's folder "
                "`.../desplat/<timestamp>/nerfstudio_models` to `--load-dir`."
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
    _check_effects(saved.effects, here.effects)
    if saved.sh_degree != here.sh_degree:
        raise CheckpointError(
            f"The checkpoint has spherical harmonics of degree {saved.sh_degree}, this run of "
            f"degree {here.sh_degree}. Add `--pipeline.model.sh-degree {saved.sh_degree}`."
        )
    if saved.train_images and here.train_images:
        _check_images(saved.train_images, here.train_images)


def _check_effects(saved: Mapping[str, Any], here: Mapping[str, Any]) -> None:
    differing = [name for name in sorted(here) if saved.get(name) != here[name]]
    if not differing:
        return
    trained = ", ".join(f"{name} {saved.get(name)}" for name in differing)
    run = ", ".join(f"{name} {here[name]}" for name in differing)
    switches = " ".join(
        f"--pipeline.model.effects.{name.replace('_', '-')} {saved.get(name)}" for name in differing
    )
    raise CheckpointError(
        f"The checkpoint was trained with other effects: {trained}; this run has {run}. "
        f"Add `{switches}`, or load a checkpoint of a run like this one."
    )


def _check_images(saved: list[str], here: list[str]) -> None:
    if saved == here:
        return
    advice = (
        "Pass the `--data` and the split options that the checkpoint was trained with, or drop "
        "`--load-dir` to train from the start."
    )
    only_saved, only_here = sorted({*saved} - {*here}), sorted({*here} - {*saved})
    if not only_saved and not only_here:
        raise CheckpointError(
            "The checkpoint was trained on the same photos in another order, and each training "
            f"view's distractors would land in another view. {advice}"
        )
    example = only_saved[0] if only_saved else only_here[0]
    side = "the checkpoint" if only_saved else "this run"
    raise CheckpointError(
        f"The checkpoint belongs to another scene or split: it was trained on {len(saved)} photos, "
        f"this run has {len(here)}; {len(only_saved) + len(only_here)} names differ, the first "
        f"being '{example}', which only {side} has. {advice}"
    )
