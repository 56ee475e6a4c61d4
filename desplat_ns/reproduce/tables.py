"""Which figures a table has, of which data sets and methods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

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
    figure: str
    """Of the evaluation, from which it comes."""
    digits: int = 2
    is_rate: bool = False
    """Whether it is one over the evaluation's figure."""
    is_time: bool = False
    """Whether it is written as minutes:seconds."""

    def of(self, figures: Mapping[str, float | int]) -> float | None:
        """Its value; None where the evaluation has no such figure."""
        value = figures.get(self.figure)
        if value is None or (self.is_rate and value <= 0):
            return None
        return 1 / value if self.is_rate else float(value)

    def text(self, value: float | int) -> str:
        """As tables write it."""
        if not self.is_time:
            return f"{value:.{self.digits}f}"
        minutes, seconds = divmod(round(abs(value)), 60)
        return f"{'-' * (value < 0)}{minutes}:{seconds:02d}"

    def difference(self, value: float | int) -> str:
        """The same with its sign."""
        text = self.text(value)
        return text if text.startswith("-") else f"+{text}"


IMAGES = (
    Metric("psnr", "PSNR, dB, the higher the better", "psnr"),
    Metric("ssim", "SSIM, the higher the better", "ssim", 3),
    Metric("lpips", "LPIPS, the lower the better", "lpips", 3),
)

MEMORY = (
    Metric("static_mb", "Static Gaussians, MB (10^6 bytes)", "static_memory_mb"),
    Metric("distractor_mb", "Distractor Gaussians, MB (10^6 bytes)", "distractor_memory_mb"),
)

TIME = (
    Metric(
        "train_seconds",
        "Training steps, minutes:seconds, without set-up and evaluation",
        "train_wall_seconds",
        is_time=True,
    ),
)

SPEED = (
    Metric(
        "fps_with_metrics",
        "Images per second, rendered and scored, as ns-eval counts them (App. C.2)",
        "seconds_per_image_with_metrics",
        is_rate=True,
    ),
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
