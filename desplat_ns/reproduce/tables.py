"""Which figures a table has, of which data sets and methods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from desplat_ns.reproduce.protocols import (
    MIPNERF360,
    ON_THE_GO,
    PHOTO_TOURISM,
    ROBUSTNERF,
    ROBUSTNERF_RATIOS,
    Protocol,
    Scene,
)

TableName = Literal["robustnerf", "on-the-go", "fig9", "A5", "A6", "A7", "A8", "A9"]


@dataclass(frozen=True)
class Metric:
    """A figure of a table."""

    name: str
    title: str
    score: str
    """Of the evaluation, from which it comes."""
    digits: int = 2
    is_rate: bool = False
    """Whether it is one over the evaluation's score."""
    is_time: bool = False
    """Whether it is written as minutes:seconds."""

    def of(self, scores: Mapping[str, Any]) -> float | None:
        """Its value; None where the evaluation has no such score."""
        value = scores.get(self.score)
        if value is None or (self.is_rate and value <= 0):
            return None
        return 1 / value if self.is_rate else float(value)

    def text(self, value: float | int, sign: str = "") -> str:
        """As tables write it; with `sign` "+" also a positive value has its sign."""
        if not self.is_time:
            return f"{value:{sign}.{self.digits}f}"
        minutes, seconds = divmod(round(abs(value)), 60)
        return f"{'-' if value < 0 else sign}{minutes}:{seconds:02d}"


IMAGES = (
    Metric("psnr", "PSNR, dB, the higher the better", "psnr"),
    Metric("ssim", "SSIM, the higher the better", "ssim", 3),
    Metric("lpips", "LPIPS, the lower the better", "lpips", 3),
)

MEMORY = (
    Metric("static_mb", "Static Gaussians, MB (10^6 bytes)", "static_memory_mb"),
    Metric("distractor_mb", "Distractor Gaussians, MB (10^6 bytes)", "distractor_memory_mb"),
)

_STEPS = "Training steps, minutes:seconds, without set-up and evaluation"
TIME = (Metric("train_seconds", _STEPS, "train_wall_seconds", is_time=True),)

_SCORED = "Images per second, rendered and scored, as ns-eval counts them (App. C.2)"
SPEED = (
    Metric("fps_with_metrics", _SCORED, "seconds_per_image_with_metrics", is_rate=True),
    Metric("fps", "Images per second, rendered alone", "seconds_per_image_render", is_rate=True),
)


@dataclass(frozen=True)
class Table:
    """A table of the paper."""

    name: TableName
    title: str
    protocols: tuple[Protocol, ...]
    metrics: tuple[Metric, ...]
    note: str = ""
    """What else a reader of the figures has to know."""

    @property
    def scenes(self) -> tuple[Scene, ...]:
        """All of them, in the order of the columns."""
        return tuple(scene for protocol in self.protocols for scene in protocol.scenes)

    @property
    def methods(self) -> tuple[str, ...]:
        """Those that are compared, if no others are asked for."""
        names = (name for protocol in self.protocols for name in protocol.methods)
        return tuple(dict.fromkeys(names))


_BOTH = (ROBUSTNERF, ON_THE_GO)
_MAIN_TEXT = "The paper's figures are in its main text; this package has those of the supplement."
_V100 = "The paper's are of a Tesla V100 (B.3)."

TABLES: dict[TableName, Table] = {
    table.name: table
    for table in (
        Table("robustnerf", "RobustNeRF", (ROBUSTNERF,), IMAGES, _MAIN_TEXT),
        Table("on-the-go", "NeRF On-the-go", (ON_THE_GO,), IMAGES, _MAIN_TEXT),
        Table("fig9", "Fig. 9 left: shares of clutter", (ROBUSTNERF_RATIOS,), IMAGES, _MAIN_TEXT),
        Table("A5", "Table A5: Photo Tourism", (PHOTO_TOURISM,), IMAGES),
        Table("A6", "Table A6: Mip-NeRF 360", (MIPNERF360,), IMAGES),
        Table("A7", "Table A7: memory", _BOTH, MEMORY, "The paper does not say which MB it means."),
        Table("A8", "Table A8: training time", _BOTH, TIME, _V100),
        Table("A9", "Table A9: rendering speed", _BOTH, SPEED, _V100),
    )
}
"""By the name that is typed."""
