"""What a run was and what it cost: steps, time, Gaussians, bytes, machine."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.runs.loading import LoadedRun


@dataclass(frozen=True)
class Cost:
    """A run in numbers."""

    experiment: str
    method: str
    capture: str
    """The folder that was trained on."""
    steps: int
    """Done."""
    planned: int
    """Steps that the run was meant to have."""
    num_photos: int
    """Training photos."""
    seconds: float | None
    """Of training; None if the run did not record it."""
    budget: str
    """Wall time that the run was given; empty if none."""
    num_static: int
    num_distractors: int
    parameter_mb: float
    """10^6 bytes that the Gaussians' parameters take."""
    checkpoint_mb: float
    """10^6 bytes."""
    trained_on: str
    """In words: the device, and whether it was this machine."""

    @property
    def visits(self) -> float:
        """How often each photo was seen."""
        return self.steps / self.num_photos


def cost_of(
    run: LoadedRun, seconds: float | None, num_photos: int, counts: Mapping[str, Any]
) -> Cost:
    """Gather what a run cost.

    Args:
        seconds: of training, where that was logged.
        counts: see `gaussian_counts`.
    """
    config = run.config
    return Cost(
        str(config.experiment_name),
        str(config.method_name),
        from_here(config.pipeline.datamanager.data),
        run.steps,
        config.max_num_iterations,
        num_photos,
        seconds,
        config.budget,
        counts["num_static_gaussians"],
        counts["num_distractor_gaussians"],
        counts["static_memory_mb"] + counts["distractor_memory_mb"],
        run.checkpoint.stat().st_size / 1e6,
        trained_on(config.machine.device_type, run.files.events, socket.gethostname()),
    )


def trained_on(device: str, events: list[Path], host: str) -> str:
    """The device, and whether it was this machine, by the names of a run's event files: these hold
    the host's name, which is not given away."""
    what = {"cuda": "a GPU", "cpu": "the CPU", "mps": "an Apple GPU"}.get(device, device)
    if not events:
        return f"{what}; which machine was not recorded"
    is_here = all(f".{host}." in path.name for path in events)
    return f"{what} of {'this machine' if is_here else 'another machine'}"


def from_here(path: Path | None) -> str:
    """A path as somebody types it in the folder at hand, if it lies below; a page that is sent to
    somebody then says nothing of the machine."""
    if path is None:
        return ""
    inside, here = path.absolute(), Path.cwd()
    return str(inside.relative_to(here) if inside.is_relative_to(here) else path)
