"""Generated scenes with every combination of effects, and what is true of each.

Thresholds were set on `SETTING`, decisions are counted on `EVALUATION`: other seeds, other
strengths.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Literal

from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.survey.observations import Capture, capture_of
from lab.grid.captures import made
from lab.synthetic import DaylightSpec, OccluderSpec, SceneSpec, write_scene

Appearance = Literal["off", "camera", "affine"]
Background = Literal["off", "constant", "sh", "image"]

PLAIN_SKY = (0.62, 0.72, 0.86)
"""Of the scenes in which the sky is one colour."""


@dataclass(frozen=True)
class Truth:
    """What a scene calls for."""

    appearance: Appearance
    background: Background
    distractors: bool


@dataclass(frozen=True)
class Strengths:
    """How strong each effect is where there is one."""

    light: float
    """Of the daylights; 1 is noon, clouds and dusk."""
    sun: float
    """Degrees to either side."""
    wall: float
    """Metres; the lower, the more sky."""
    covered: tuple[float, float]
    """Share of a view behind occluders, see `OccluderSpec`."""
    is_visible: bool = True
    """Whether somebody who leafs through the photos notices the effects at once."""


@dataclass(frozen=True)
class GeneratedScene:
    """One scene."""

    truth: Truth
    strengths: Strengths
    seed: int
    label: str

    @property
    def name(self) -> str:
        """For tables."""
        truth = self.truth
        people = "distractors" if truth.distractors else "still"
        return f"{truth.appearance}/{truth.background}/{people}, {self.label}, seed {self.seed}"

    def spec(self) -> SceneSpec:
        """What is generated: 20 views of 160x120."""
        truth, strengths = self.truth, self.strengths
        low, high = strengths.covered
        spec = SceneSpec(
            num_views=20,
            num_extras=3,
            width=160,
            height=120,
            wall_height=6.0 if truth.background == "off" else strengths.wall,
            occluders=OccluderSpec(min_fraction=low, max_fraction=high),
            seed=self.seed,
        )
        if truth.appearance == "off" and truth.background in ("off", "sh"):
            return spec
        daylight = DaylightSpec(
            strength=0.0 if truth.appearance == "off" else strengths.light,
            sky=truth.background == "image",
            sun=strengths.sun if truth.appearance == "affine" else 0.0,
            plain_sky=PLAIN_SKY if truth.background == "constant" else None,
        )
        return replace(spec, daylight=daylight)

    @property
    def folder_name(self) -> str:
        """The name without what a path cannot hold."""
        return self.name.replace("/", "_").replace(", ", "_").replace(" ", "")

    def make(self, scenes: Path) -> Capture:
        """Open the photos that have occluders, or their twins without; written if not there yet."""
        folder = made(scenes / self.folder_name, lambda path: write_scene(self.spec(), path))
        ratio = 1.0 if self.truth.distractors else 0.0
        parser = RobustNerfDataParserConfig(data=folder, train_split_clean_clutter_ratio=ratio)
        return capture_of(parser.setup().get_dataparser_outputs("train"))


COMBINATIONS = [
    Truth(appearance, background, distractors)
    for appearance, background, distractors in product(
        ("off", "camera", "affine"), ("off", "constant", "sh", "image"), (False, True)
    )
]
"""All 24."""


def _scenes(
    first_seed: int, label: str, strengths: Strengths, truths: Sequence[Truth] = COMBINATIONS
) -> Iterator[GeneratedScene]:
    for number, truth in enumerate(truths):
        yield GeneratedScene(truth, strengths, first_seed + number, label)


SETTING = tuple(_scenes(100, "setting", Strengths(0.8, 80.0, 2.6, (0.08, 0.3))))
"""Scenes on which thresholds were set."""

EVALUATION = (
    *_scenes(700, "strong", Strengths(1.0, 120.0, 2.2, (0.15, 0.45))),
    *_scenes(800, "middle", Strengths(0.65, 60.0, 2.8, (0.06, 0.2))),
    *_scenes(
        900,
        "faint",
        Strengths(0.25, 15.0, 3.2, (0.01, 0.1), is_visible=False),
        COMBINATIONS[1::3] + COMBINATIONS[::6],
    ),
)
"""Scenes on which decisions are counted; of the faint ones it is only told what was decided."""
