"""Checkpoint files: written so that a kill or a full disk never costs what was saved before.

The files are nerfstudio's (`step-000000299.ckpt`): `ns-eval` and the other commands read them.
"""

import pickle
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import torch

from desplat_ns.core.console import announce
from desplat_ns.core.errors import CheckpointError, ConfigError
from desplat_ns.core.whole import draft_of, only_process_in

STAGING_FOLDER = ".saving"
"""Where a checkpoint is written before it is complete. Beside the checkpoint folder, not in it:
nerfstudio 1.1.5 takes every name in that folder for a checkpoint and fails on any other."""


def checkpoint_path(folder: Path, step: int) -> Path:
    """The file that holds the state after `step` (counted from 0) in `folder`."""
    return folder / f"step-{step:09d}.ckpt"


def step_of(path: Path) -> int:
    """The step in a checkpoint's file name."""
    return int(path.stem.removeprefix("step-"))


def checkpoints_in(folder: Path) -> list[Path]:
    """Checkpoints of a folder, the newest (highest step) last; none where there is no folder."""
    named = (path for path in folder.glob("step-*.ckpt") if path.stem[len("step-") :].isdecimal())
    return sorted(named, key=step_of)


# --- written -------------------------------------------------------------------------------------


def save_atomically(state: dict[str, Any], path: Path) -> None:
    """Write `state` to `path`, which is at any moment the old file, the new one or absent. Raises
    CheckpointError where it cannot be written; nothing saved before is touched then."""
    staging = path.parent.resolve().parent / STAGING_FOLDER
    try:
        with draft_of(path, staging) as draft, draft.open("wb") as file:
            torch.save(state, file)
    except (OSError, RuntimeError) as error:
        # torch's zip writer reports a failed write as RuntimeError, the OSError is its context
        reason = error.__context__ if isinstance(error.__context__, OSError) else error
        raise CheckpointError(
            f"The checkpoint {path} could not be written: {reason}. Checkpoints saved before are "
            f"untouched. Free some space there (or choose another place with --output-dir), then "
            f"go on with `--load-dir {path.parent}`."
        ) from error


def remove_older(path: Path) -> None:
    """Delete the checkpoints beside `path`, which must be complete, but for the one before it: that
    is gone on from if `path` gets damaged."""
    saved = checkpoints_in(path.parent)
    at = saved.index(path)
    for other in saved[: max(0, at - 1)] + saved[at + 1 :]:
        with suppress(OSError):  # another program reads it, or has removed it
            other.unlink()


def refuse_to_replace(checkpoints: Path, goes_on_from: Path | None) -> None:
    """Raise ConfigError where a run would replace what another has trained in its folder, or the
    same one after the checkpoint that it goes on from; damaged ones are no loss."""
    saved = checkpoints_in(checkpoints)
    if goes_on_from is not None and goes_on_from.resolve().parent == checkpoints.resolve():
        saved = [p for p in saved if step_of(p) > step_of(goes_on_from) and _is_intact(p)]
    if saved:
        raise ConfigError(
            f"{saved[-1]} is of an earlier run, which this one would replace. Give another "
            "--timestamp, or leave it out for the time of day; --load-dir "
            f"{checkpoints} goes on with the earlier run."
        )


def _is_intact(path: Path) -> bool:
    with suppress(CheckpointError):
        return bool(load_checkpoint(path))
    return False


@contextmanager
def run_folder(folder: Path) -> Iterator[None]:
    """As `only_process_in`; after KeyboardInterrupt nerfstudio's commands would end with 0."""
    try:
        with only_process_in(folder):
            yield
    except KeyboardInterrupt:
        announce("Ended by Ctrl+C before the first step.", warning=True)
        raise SystemExit(130) from None


# --- read ----------------------------------------------------------------------------------------


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read one checkpoint onto the CPU, every byte checked against the file's checksums. Raises
    CheckpointError where it is missing, damaged or not a checkpoint."""
    if not path.is_file():
        raise CheckpointError(f"There is no checkpoint {path}.")
    try:
        with zipfile.ZipFile(path) as archive:
            if damaged := archive.testzip():
                raise zipfile.BadZipFile(f"bad checksum in {damaged}")
        state = torch.load(path, map_location="cpu", weights_only=True)
        for name in ("step", "pipeline", "optimizers"):
            _ = state[name]
    except (PermissionError, MemoryError):
        raise
    except Exception as error:  # damaged bytes raise whatever the unpickler stumbles over
        why = f"{type(error).__name__}: {error}"
        if isinstance(error, pickle.UnpicklingError):  # torch's text advises to read it unsafely
            why = "it names code that no training saves, which is not run"
        raise CheckpointError(
            f"The checkpoint {path} is damaged or not a checkpoint ({why}). Give another one "
            "with `--load-checkpoint FILE`."
        ) from error
    return state


def load_newest(folder: Path, step: int | None = None) -> tuple[Path, dict[str, Any]]:
    """The newest intact checkpoint of `folder`, or that of a step, and its contents; says so where
    a newer one is damaged. Raises CheckpointError where none is left."""
    if step is not None:
        path = checkpoint_path(folder, step)
        return path, load_checkpoint(path)
    for path in reversed(checkpoints_in(folder)):
        try:
            return path, load_checkpoint(path)
        except CheckpointError as error:
            announce(str(error), warning=True)
    raise CheckpointError(f"{folder} holds no intact checkpoint.")


def checkpoint_folder(load_dir: Path, relative_model_dir: Path) -> Path:
    """The folder of checkpoints that `--load-dir` means: itself, or that inside a run's folder.
    Raises CheckpointError where there is none."""
    for folder in (load_dir, load_dir / relative_model_dir):
        if checkpoints_in(folder):
            return folder
    raise CheckpointError(
        f"--load-dir {load_dir} holds no checkpoint. Give a run's folder, or the folder "
        f"{relative_model_dir} in it."
    )
