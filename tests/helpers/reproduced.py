"""A grid of a table over scenes that nobody reads, and an executor that makes records up."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from desplat_ns.reproduce.grid import Grid, Request
from desplat_ns.reproduce.methods import METHODS
from desplat_ns.reproduce.protocols import Smoke
from desplat_ns.reproduce.records import Records
from desplat_ns.reproduce.scenes import Content, FoundScene
from desplat_ns.reproduce.tables import TABLES, TableName
from desplat_ns.studies.executors import Executor, Keep
from desplat_ns.studies.runs import Record, Run

CONTENT = Content(photos=20, held_out=5, width=100, height=80)


def made_up(run: Run) -> Record:
    """A record whose figures depend on the run alone."""
    number = sum(map(ord, run.variant.name)) % 50 + run.seed - 42
    figures = {
        "psnr": 20 + number / 10,
        "ssim": 0.5 + number / 1000,
        "lpips": 0.3,
        "static_memory_mb": 40.0 + number,
        "distractor_memory_mb": 10.0,
        "train_wall_seconds": 600.0 + number,
        "seconds_per_image_render": 0.005,
        "seconds_per_image_with_metrics": 0.01,
        "run_wall_seconds": 700.0,
    }
    return Record(figures, "c0ffee", "cuda", "gsplat")


@dataclass
class MadeUpExecutor:
    """Does runs without doing them; may be killed on the way, or fail at some."""

    most: int = 10_000
    """Runs, before it is killed."""
    failing: str = ""
    """In the names of runs that fail."""
    done: list[str] = field(default_factory=list)

    def do(self, runs: Iterable[Run], folder: Path, keep: Keep) -> list[bool]:
        """See `Executor`."""
        kept = []
        for run in runs:
            if len(self.done) == self.most:
                raise KeyboardInterrupt
            self.done.append(run.name)
            fails = self.failing and self.failing in run.name
            kept.append(keep(run, ValueError("too dark") if fails else made_up(run)))
        return kept


def request_of(
    name: TableName,
    output: Path,
    executor: Executor,
    seeds: int = 1,
    is_smoke: bool = False,
    methods: tuple[str, ...] = (),
    device: str = "cuda",
) -> Request:
    table = TABLES[name]
    taken = tuple(METHODS[method] for method in methods or table.methods)
    return Request(
        *(table, output.parent / "data", output, taken, seeds, executor, 1, device),
        smoke=Smoke() if is_smoke else None,
    )


def grid_of(request: Request, records: Records | None = None) -> Grid:
    """All scenes of its table, as if they were there."""
    contents = {
        FoundScene(protocol, scene, Path("/data") / protocol.folder / scene.folder): CONTENT
        for protocol in request.table.protocols
        for scene in protocol.scenes
    }
    return Grid(request, contents, records or Records.load(request.output))
