"""The runs of a table: every method on every scene with every seed."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from threading import Lock

from desplat_ns.console import announce, list_names
from desplat_ns.errors import CaptureError, ConfigError, DeSplatError
from desplat_ns.files.lock import only_process_in
from desplat_ns.files.pages import time_in_words
from desplat_ns.files.whole import check_room
from desplat_ns.rendering.metrics import LpipsNet, lpips_weights
from desplat_ns.reproduce.cells import cells_of
from desplat_ns.reproduce.estimate import expected_bytes, expected_seconds
from desplat_ns.reproduce.methods import Method
from desplat_ns.reproduce.protocols import Smoke
from desplat_ns.reproduce.records import RUNS, Done, Records, asked_of, texts_of
from desplat_ns.reproduce.results import Results
from desplat_ns.reproduce.scenes import (
    Content,
    FoundScene,
    any_scenes,
    checked,
    find_scenes,
    what_is_missing,
)
from desplat_ns.reproduce.tables import Table
from desplat_ns.reproduce.writing import write_table
from desplat_ns.studies.executors import Executor
from desplat_ns.studies.methods import method_config
from desplat_ns.studies.runs import Figures, Record, Run, Variant, remove_checkpoints

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
    jobs: int
    """Runs beside each other."""
    device: str
    """Type of the device on which this machine trains."""
    smoke: Smoke | None = None
    """How it is cut short; None: it is not."""
    is_here: bool = True
    """Whether runs are done on this machine."""

    @property
    def is_smoke(self) -> bool:
        """Whether it is cut short."""
        return self.smoke is not None

    @property
    def folder(self) -> Path:
        """Of the table's files."""
        return self.output / (self.table.name + "-smoke" * self.is_smoke)


Key = tuple[str, str, int]
"""Scene, method and seed."""


def run_of(found_scene: FoundScene, method: Method, seed: int, smoke: Smoke | None = None) -> Run:
    """A cell of the grid as it is trained."""
    protocol = found_scene.protocol
    options = method.options if smoke is None else method.options + SMOKE_OPTIONS
    if hasattr(method_config(method.method).pipeline, "evaluation"):
        options += ("--pipeline.evaluation.protocol", method.scoring(protocol))
        options += ("--pipeline.evaluation.lpips-net", protocol.lpips_net)
    name = f"{protocol.name}.{found_scene.scene.label}.{method.name}"
    steps = protocol.steps if smoke is None else smoke.steps
    return Run(
        Variant(name, method.what, options, method.method),
        steps,
        seed,
        found_scene.folder,
        found_scene.parser,
    )


@dataclass
class Grid:
    """The work on a table from one start of the command to its end."""

    request: Request
    contents: dict[FoundScene, Content]
    records: Records
    missing: list[str] = field(default_factory=list)
    """Names of scenes that are not there."""
    failed: dict[str, str] = field(default_factory=dict)
    """Why a run gave no figure, by its name."""

    def __post_init__(self) -> None:
        request = self.request
        seeds = range(FIRST_SEED, FIRST_SEED + request.seeds)
        self.seeds = tuple(seeds)
        self.runs: dict[Key, Run] = {
            (found_scene.scene.name, method.name, seed): run_of(
                found_scene, method, seed, request.smoke
            )
            for seed in seeds
            for found_scene in self.contents
            for method in request.methods
        }
        self._keeping, self._seconds = Lock(), list[float]()

    def left(self) -> list[Run]:
        """Runs that are not done. Raises ConfigError, see `Records.of`."""
        return [run for run in self.runs.values() if self.records.of(run) is None]

    def do(self) -> None:
        """Do what is left. Raises ConfigError where nothing can be written."""
        folder, left = (self.request.output / RUNS).resolve(), self.left()
        self.records.save(self.request.output)
        folder.mkdir(parents=True, exist_ok=True)
        if left:
            self.request.executor.do(left, folder, partial(self._keep, folder))

    def _keep(self, folder: Path, run: Run, outcome: Record | Exception) -> bool:
        """Record a run and remove its checkpoints; False if it failed, which is said."""
        remove_checkpoints(run.name, folder)
        if isinstance(outcome, Exception):
            kind = "" if isinstance(outcome, DeSplatError) else f"{type(outcome).__name__}: "
            self.failed[run.name] = f"{kind}{outcome}"
            announce(f"{run.name}: {self.failed[run.name]}", warning=True)
            return False
        with self._keeping:  # runs beside each other share the records
            self.records.done[run.name] = Done(outcome, asked_of(run), texts_of(run, folder))
            self.records.save(self.request.output)
            self._seconds.append(outcome.figures["run_wall_seconds"])
        left = len(self.left()) - len(self.failed)
        rest = left * sum(self._seconds) / len(self._seconds) / self.request.jobs
        more = f"; {left} left, about {time_in_words(rest)}" if left > 0 else ""
        announce(f"{run.name}: {outcome.figures['psnr']:.2f} dB{more}")
        return True

    def results(self) -> Results:
        """What the runs that are done say."""
        request = self.request

        def lookup(scene: str, method: str, seed: int) -> Figures | None:
            done = self.records.of(self.runs[scene, method, seed])
            return None if done is None else done.record.figures

        names = [found_scene.scene.name for found_scene in self.contents]
        cells = cells_of(
            *(request.table, names, request.methods, self.seeds, lookup, request.is_smoke)
        )
        done = [
            record for run in self.runs.values() if (record := self.records.of(run)) is not None
        ]
        return Results(
            *(request.table, request.is_smoke, self.contents, request.methods, self.seeds),
            *(cells, done, self.missing, self.failed),
        )


def reproduce(request: Request) -> Path:
    """Run what a table needs and write it; the folder that holds it.

    Raises:
        CaptureError: scenes cannot be read, or none is there.
        ConfigError: the output folder will not do, the disk will not hold the runs, or this machine
            has no GPU; then it says how long they would take.
        DeSplatError: runs failed; the table is written without them.
    """
    with only_process_in(request.output):
        grid = open_grid(request)
        prepare(grid)
        grid.do()
        write_table(request.folder, grid.results())
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
    records = Records.load(request.output)
    found_scenes, missing = find_scenes(request.table, request.data)
    said = what_is_missing(request.table, missing, request.data) if missing else ""
    if request.is_smoke and not found_scenes:
        found_scenes = any_scenes(request.table, request.data)
    if not found_scenes:
        raise CaptureError(said)
    if said:
        announce(said, warning=True)
    contents = checked(found_scenes, request.smoke)
    return Grid(request, contents, records, [scene.name for _, scene in missing])


def prepare(grid: Grid) -> None:
    """Say what will be run, how long it takes and what it leaves on the disk, and whether it can.

    Raises:
        ConfigError: as `reproduce`.
    """
    request, left = grid.request, grid.left()
    went_on = f", {len(grid.runs) - len(left)} of which are done" * (len(left) < len(grid.runs))
    steps = list_names(dict.fromkeys(f"{run.steps:,}" for run in grid.runs.values()))
    announce(
        f"{request.table.title}. Scenes: {len(grid.contents)}, methods: {len(request.methods)}, "
        f"seeds: {request.seeds}. Runs: {len(grid.runs)}, of {steps} steps{went_on}."
    )
    for found_scene, content in grid.contents.items():
        announce(
            f"    {found_scene.scene.name}: {content.photos} photos train, "
            f"{content.held_out} test, {content.width} x {content.height}; {found_scene.folder}"
        )
    if not left:
        return
    _check_disk(grid)
    _say_weights(grid)
    if request.is_smoke or not request.is_here:
        return
    said = _say_time(grid, left)
    if request.device == "cpu":
        raise ConfigError(
            f"This machine has no GPU, on which the runs ({len(left)}) are meant to be done{said}. "
            "Add --smoke to try the same with few steps and small photos."
        )
    announce(f"Runs to do: {len(left)}{said}.")


def _say_weights(grid: Grid) -> None:
    """Where LPIPS's weights belong, if they are not there yet: hours later is too late."""
    if not any(metric.name == "lpips" for metric in grid.request.table.metrics):
        return
    nets: set[LpipsNet] = {found_scene.protocol.lpips_net for found_scene in grid.contents}
    for net in sorted(nets):
        if not (path := lpips_weights(net)).is_file():
            announce(
                f"LPIPS's weights are not at {path}: they are fetched with the first score. Where "
                "there is no network, copy them there first; else LPIPS is left out.",
                warning=True,
            )


def _say_time(grid: Grid, left: list[Run]) -> str:
    scene = next(iter(grid.contents))
    seconds = expected_seconds(scene, left, grid.request.device)
    if seconds is None:
        return ": how long they take is not known of methods that are none of this package's"
    words = time_in_words(seconds / grid.request.jobs)
    return f": they would take about {words} here, by steps timed at the size of {scene.scene.name}"


def _check_disk(grid: Grid) -> None:
    def pixels(found_scene: FoundScene) -> int:
        content = grid.contents[found_scene]
        return content.photos * content.width * content.height

    request, to_do = grid.request, grid.left()
    left = Counter(scene for (scene, _, _), run in grid.runs.items() if run in to_do)
    contents = [
        (content, left[found_scene.scene.name]) for found_scene, content in grid.contents.items()
    ]
    largest = max(grid.contents, key=pixels)
    needed = expected_bytes(contents, largest, request.jobs, request.device)
    announce(f"Disk: {needed / 1e6:,.0f} MB at most while it runs, for pictures and checkpoints.")
    check_room(request.output, needed, "the runs need")
