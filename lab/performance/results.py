"""Everything that one run measures, and the figures that follow from it."""

from __future__ import annotations

from dataclasses import dataclass, field

from desplat_ns.calibration.timing import Timing
from lab.performance.distractors_price import Price
from lab.performance.pairs import Pairs
from lab.performance.serial_share import Serial
from lab.performance.steps import StepTimes
from lab.performance.yardstick import YARDSTICK
from lab.pixels.accuracy import Errors
from lab.pixels.growth import Point
from lab.pixels.rasterizing import BLENDING, Row


@dataclass
class Results:
    """What `run` fills in, and `report` writes down."""

    machine: dict[str, str]
    missing: dict[str, str]
    """Backends that cannot run here, with the reason."""
    scenes: list[str] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    steps: list[StepTimes] = field(default_factory=list)
    adam: dict[str, dict[str, Timing]] = field(default_factory=dict)
    """By scene, then by kind."""
    memory: dict[tuple[str, str], float | None] = field(default_factory=dict)
    """MiB by (scene, contender)."""
    errors: list[Errors] = field(default_factory=list)
    pairs: dict[str, Pairs] = field(default_factory=dict)
    """By scene."""
    peaks: dict[int, float] = field(default_factory=dict)
    """GFLOP/s of one core by bits of a vector."""
    growth: list[Point] = field(default_factory=list)
    prices: list[Price] = field(default_factory=list)
    serial: list[Serial] = field(default_factory=list)
    """Empty where there is one core."""

    def row(self, scene: str, contender: str, part: str, threads: int = 1) -> Row:
        """Times of one contender. Raises KeyError where it was not measured."""
        for row in self.rows:
            if (row.scene, row.contender, row.part, row.threads) == (
                scene,
                contender,
                part,
                threads,
            ):
                return row
        raise KeyError((scene, contender, part, threads))

    def speedup(self, row: Row) -> float:
        """CPU time of the yardstick's forward + backward over that of `row`."""
        yardstick = self.row(row.scene, YARDSTICK.name, row.part, row.threads)
        return yardstick.both.cpu_ms / row.both.cpu_ms

    def step(self, scene: str, name: str, threads: int = 1) -> StepTimes:
        """Times of one kind of step. Raises KeyError where it was not measured."""
        for step in self.steps:
            if (step.scene, step.name, step.threads) == (scene, name, threads):
                return step
        raise KeyError((scene, name, threads))

    def gflops(self, scene: str, pairs: int, backward: bool, flops: int) -> float:
        """Rate of the `numba` backend's blending, 1 thread, at so many operations a pair."""
        row = self.row(scene, "numba", BLENDING)
        milliseconds = row.forward.cpu_ms
        if backward:
            milliseconds = row.both.cpu_ms - milliseconds
        return pairs * flops / milliseconds / 1e6

    @property
    def peak(self) -> float:
        """The best of `peaks`."""
        return max(self.peaks.values())
