"""Our own studies: a setting on a scene, at a size, for a number of steps, with a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from desplat_ns.studies.methods import method_config
from desplat_ns.studies.runs import EXPERIMENT, TIMESTAMP, Variant
from desplat_ns.studies.runs import Run as Job

DATA_VARIABLE = "DESPLAT_NS_DATA"
"""Environment variable with the folder that holds real captures."""


@runtime_checkable
class Capture(Protocol):
    """A folder of photos that a dataparser reads."""

    def locate(self, folder: Path) -> Path:
        """The capture's folder; what has to be written is written below `folder`, once.

        Raises:
            DeSplatError: it is not there and cannot be made.
        """
        ...

    def describe(self) -> str:
        """What it shows, in words that differ where what is written would."""
        ...


@dataclass(frozen=True)
class Setting:
    """A method and its options."""

    method: str
    """A name that nerfstudio knows, or `module:attribute` of a MethodSpecification."""
    options: tuple[str, ...] = ()
    what: str = ""
    """As tables call it."""


@dataclass(frozen=True)
class Scene:
    """A capture and how it is read."""

    capture: Capture
    parser: tuple[str, ...]
    """The dataparser's name and its options."""


@dataclass(frozen=True)
class Run:
    """One training run and its evaluation."""

    setting: str
    scene: str
    downscale: int
    steps: int
    seed: int

    @property
    def name(self) -> str:
        return f"{self.cell}-{self.seed}"

    @property
    def cell(self) -> str:
        """What runs that differ in nothing but their seed have in common."""
        return f"{self.setting}-{self.scene}-{self.downscale}-{self.steps}"


@dataclass(frozen=True)
class Study:
    """What is run, and what is kept of it."""

    settings: Mapping[str, Setting]
    scenes: Mapping[str, Scene]
    plan: tuple[Run, ...]
    """Every run that the document wants, the quick and the important first."""
    figures: tuple[str, ...]
    """Names of what is recorded, of what the evaluation gives; absent ones are left out. The first
    is said when a run is done."""
    evaluations: int = 1
    """How often a run is scored: in the end, after half of its steps, after a quarter, and so on;
    with more than one its record has a curve."""

    def job(self, run: Run, data: Path) -> Job:
        """A run as it is executed.

        Args:
            data: the capture's folder.
        """
        scene, setting = self.scenes[run.scene], self.settings[run.setting]
        smaller = ("--downscale-factor", str(run.downscale)) if run.downscale > 1 else ()
        name = f"{run.setting}-{run.scene}-{run.downscale}"
        variant = Variant(name, setting.what, setting.options, setting.method)
        parser = (*scene.parser, *smaller)
        return Job(variant, run.steps, run.seed, data, parser, self.evaluations)

    def given_of(self, run: Run) -> str:
        """What `ns-train` is given for a run, beside its length, its seed and the places."""
        job = self.job(run, Path())
        return " ".join((job.variant.method, *job.variant.options, *job.parser))

    def config_of(self, run: Run, folder: Path) -> Path:
        """Where nerfstudio's config.yml of an executed run is."""
        method = method_config(self.settings[run.setting].method).method_name
        return folder / run.name / EXPERIMENT / method / TIMESTAMP / "config.yml"
