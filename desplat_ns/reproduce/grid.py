"""The runs of a table: every method on every scene with every seed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from desplat_ns.console import announce, list_names
from desplat_ns.errors import CaptureError, ConfigError, DeSplatError
from desplat_ns.files.lock import only_process_in
from desplat_ns.files.pages import time_in_words
from desplat_ns.rendering.metrics import lpips_weights
from desplat_ns.reproduce.methods import Method
from desplat_ns.reproduce.protocols import LPIPS_NET, Smoke
from desplat_ns.reproduce.scenes import (
    FoundScene,
    any_scenes,
    checked,
    find_scenes,
    what_is_missing,
)
from desplat_ns.reproduce.tables import Table
from desplat_ns.reproduce.writing import write_table
from desplat_ns.studies.executors import RUNS, Executor, open_records
from desplat_ns.studies.methods import Content, method_config
from desplat_ns.studies.records import FILE, Key, Record
from desplat_ns.studies.runs import Run

FIRST_SEED = 42
SMOKE_OPTIONS = ("--pipeline.model.num-downscales", "0")
"""Photos of a smoke run are small enough."""


@dataclass(frozen=True)
class Request:
    """What a user asks for."""

    table: Table
    data: Path
    """Folder with the data sets."""
    output: Path
    methods: tuple[Method, ...]
    seeds: int
    executor: Executor
    device: str
    """Type of the device on which runs are done, `cpu` or `cuda`."""
    smoke: Smoke | None = None
    """How it is cut short; None: it is not."""

    @property
    def folder(self) -> Path:
        """Of the table's files."""
        return self.output / (self.table.name + "-smoke" * (self.smoke is not None))


def run_of(found: FoundScene, method: Method, seed: int, smoke: Smoke | None = None) -> Run:
    """A cell of the grid as it is trained."""
    protocol, options = found.protocol, method.options
    steps = protocol.steps
    if smoke is not None:
        steps, options = smoke.steps, options + SMOKE_OPTIONS
    if hasattr(method_config(method.method).pipeline, "evaluation"):
        options += ("--pipeline.evaluation.protocol", method.scoring(protocol))
        options += ("--pipeline.evaluation.lpips-net", LPIPS_NET)
    variant = f"{protocol.name}.{found.scene.label}.{method.name}"
    return Run(variant, method.method, options, steps, seed, found.folder, found.parser)


class Grid:
    """The work on a table from one start of the command to its end."""

    def __init__(
        self,
        request: Request,
        contents: dict[FoundScene, Content],
        records: dict[Key, Record],
        missing: list[str],
    ) -> None:
        """Args:
        missing: names of scenes that are not there.
        """
        self.request, self.contents, self.missing = request, contents, missing
        self.records, self.failed = records, dict[str, str]()
        self.seeds = range(FIRST_SEED, FIRST_SEED + request.seeds)
        self.runs = {
            (found.scene.name, method.name, seed): run_of(found, method, seed, request.smoke)
            for seed in self.seeds
            for found in contents
            for method in request.methods
        }

    def left(self) -> list[Run]:
        """Runs that are not done."""
        return [run for run in self.runs.values() if run.key not in self.records]

    def do(self) -> None:
        """Do what is left. Raises ConfigError where nothing can be written."""
        output, executor, left = self.request.output, self.request.executor, self.left()
        seconds = list[float]()

        def done(run: Run, record: Record) -> None:
            self.records[run.key] = record
            seconds.append(record.seconds)
            rest = len(left) - len(seconds)
            time = time_in_words(rest * sum(seconds) / len(seconds) / executor.jobs)
            psnr = f"{record.scores['psnr']:.2f} dB"
            announce(f"{run.name}: {psnr}. Runs left: {rest}, about {time}.")

        if left:
            self.failed = executor.finish(left, output / FILE, (output / RUNS).resolve(), done)


def reproduce(request: Request) -> Path:
    """Run what a table needs and write it; the folder that holds it.

    Raises:
        CaptureError: scenes cannot be read, or none is there.
        ConfigError: the output folder will not do, or this machine has no GPU.
        DeSplatError: runs failed; the table is written without them.
    """
    with only_process_in(request.output):
        grid = open_grid(request)
        prepare(grid)
        grid.do()
        write_table(request.folder, grid)
    if grid.failed:
        raise DeSplatError(
            f"{len(grid.failed)} of {len(grid.runs)} runs failed: {list_names(grid.failed)}. "
            f"'{request.folder}' has the table without them; the same command tries them again."
        )
    return request.folder


def open_grid(request: Request) -> Grid:
    """The grid over the scenes that are there, with what is done of it; says what is missing.

    Raises:
        CaptureError, ConfigError: as `reproduce`.
    """
    records = open_records(request.output)
    found, missing = find_scenes(request.table, request.data)
    said = what_is_missing(missing, request.data) if missing else ""
    if request.smoke is not None and not found:
        found = [*any_scenes(request.table, request.data)]
    if not found:
        raise CaptureError(said)
    if said:
        announce(said, warning=True)
    contents = checked(found, request.smoke)
    return Grid(request, contents, records, [scene.name for scene in missing])


def prepare(grid: Grid) -> None:
    """Say what will be run, and where LPIPS's weights belong: hours later is too late.

    Raises:
        ConfigError: this machine has no GPU.
    """
    request, left = grid.request, grid.left()
    announce(f"{request.table.title}. Runs: {len(grid.runs)}; done: {len(grid.runs) - len(left)}.")
    for found, content in grid.contents.items():
        announce(
            f"    {found.scene.name}: {content.photos} photos train, {content.held_out} test, "
            f"{content.width} x {content.height}; {found.folder}"
        )
    weights = lpips_weights(LPIPS_NET)
    scores_lpips = any(metric.name == "lpips" for metric in request.table.metrics)
    if left and scores_lpips and not weights.is_file():
        announce(
            f"LPIPS's weights are not at {weights}: they are fetched with the first score. Where "
            "there is no network, copy them there first; else LPIPS is left out.",
            warning=True,
        )
    if left and request.smoke is None and request.device == "cpu":
        raise ConfigError(
            f"This machine has no GPU, on which the runs ({len(left)}) are meant to be done. Add "
            "--smoke to try the same with few steps and small photos."
        )
