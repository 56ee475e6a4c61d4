"""`desplat-reproduce`: every method on every scene of a table with every seed, and the table in
files: means over seeds, the paper's figures beside them, and the conditions."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from desplat_ns.core.console import about, announce, list_names
from desplat_ns.core.errors import CaptureError, DeSplatError
from desplat_ns.core.whole import only_process_in, plain_errors, whole_folder
from desplat_ns.metrics import lpips_weights
from desplat_ns.tools.pages import template
from desplat_ns.tools.studies.methods import content_of, method_config, splits_of
from desplat_ns.tools.studies.paper import (
    LPIPS_NET,
    MEAN,
    Method,
    Metric,
    PaperScene,
    Table,
    figures_of,
)
from desplat_ns.tools.studies.records import FILE, RUNS, Key, Record, conditions_of, open_records
from desplat_ns.tools.studies.runs import Executor, Run

TEMPLATE = Path(__file__).with_name("table.md.jinja")

FIRST_SEED = 42

SMOKE_OPTIONS = ("--pipeline.model.num-downscales", "0")
"""Photos of a smoke run are small enough."""


class Smoke(NamedTuple):
    """How a run is cut short that tries everything and measures nothing: steps, and pixels of the
    longer side that photos have at most."""

    steps: int = 100
    side: int = 160


@dataclass
class Grid:
    """The work on a table from one start of the command to its end."""

    table: Table
    output: Path
    methods: tuple[Method, ...]
    seeds: range
    executor: Executor
    smoke: Smoke | None
    """How it is cut short; None: it is not."""
    contents: dict[PaperScene, str]
    """What is in the scenes that are there, in words."""
    missing: list[str]
    """Names of scenes that are not there."""
    records: dict[Key, Record]
    failed: dict[str, str] = field(default_factory=dict)
    """Why a run has no record, by its name."""

    @cached_property
    def runs(self) -> dict[tuple[str, str, int], Run]:
        """All, by scene, method and seed."""
        return {
            (scene.name, method.name, seed): run_of(scene, method, seed, self.smoke)
            for seed, scene, method in product(self.seeds, self.contents, self.methods)
        }

    @property
    def folder(self) -> Path:
        """Of the table's files."""
        return self.output / (self.table.name + "-smoke" * (self.smoke is not None))

    @property
    def left(self) -> list[Run]:
        """Runs that are not done."""
        return [run for run in self.runs.values() if run.key not in self.records]

    @property
    def done(self) -> list[Record]:
        """Records of the others."""
        keys = (run.key for run in self.runs.values())
        return [self.records[key] for key in keys if key in self.records]

    def time_left(self) -> str:
        """In words, once a run is done."""
        left = len(self.left)
        seconds = left * fmean(record.seconds for record in self.done) / self.executor.jobs
        return f"Runs left: {left}, {about(seconds)}."


def run_of(scene: PaperScene, method: Method, seed: int, smoke: Smoke | None = None) -> Run:
    """A cell of the grid as it is trained."""
    data_set, options = scene.data_set, method.options
    steps = data_set.steps
    if smoke is not None:
        steps, options = smoke.steps, options + SMOKE_OPTIONS
    if hasattr(method_config(method.method).pipeline, "evaluation"):
        options += ("--pipeline.evaluation.protocol", method.scoring(data_set))
        options += ("--pipeline.evaluation.lpips-net", LPIPS_NET)
    variant = f"{data_set.name}.{scene.key or scene.folder}.{method.name}"
    return Run(variant, method.method, options, steps, seed, scene.place, scene.parser)


def reproduce(
    table: Table,
    data: Path,
    output: Path,
    methods: tuple[Method, ...],
    seeds: int,
    executor: Executor,
    smoke: Smoke | None = None,
) -> Path:
    """Run what a table needs of the data sets in a folder, and write it; the folder that holds it.

    Raises:
        CaptureError: scenes cannot be read, or none is there.
        ConfigError: the output folder will not do.
        DeSplatError: runs failed; the table is written without them.
    """
    with only_process_in(output):
        records = open_records(output)
        contents, missing = find_contents(table, data, smoke)
        numbers = range(FIRST_SEED, FIRST_SEED + seeds)
        grid = Grid(table, output, methods, numbers, executor, smoke, contents, missing, records)
        announce_runs(grid)
        file, folder = output / FILE, output / RUNS
        grid.failed = executor.finish(grid.left, records, file, folder, grid.time_left)
        write_table(grid)
    if grid.failed:
        raise DeSplatError(
            f"{len(grid.failed)} of {len(grid.runs)} runs failed: {list_names(grid.failed)}. "
            f"'{grid.folder}' has the table without them; the same command tries them again."
        )
    return grid.folder


def announce_runs(grid: Grid) -> None:
    """Say what will be run, and where LPIPS's weights belong: hours later is too late."""
    table, weights = grid.table, lpips_weights(LPIPS_NET)
    announce(f"{table.title}. Runs: {len(grid.runs)}; done: {len(grid.done)}.")
    for scene, content in grid.contents.items():
        announce(f"    {scene.name}: {content}; {scene.place}")
    if grid.left and any(of.name == "lpips" for of in table.metrics) and not weights.is_file():
        announce(
            f"LPIPS's weights are not at {weights}: they are fetched with the first score. Where "
            "there is no network, copy them there first; else LPIPS is left out.",
            warning=True,
        )


# --- scenes --------------------------------------------------------------------------------------


def find_contents(
    table: Table, data: Path, smoke: Smoke | None = None
) -> tuple[dict[PaperScene, str], list[str]]:
    """What is in the scenes of a table that are there, with their places, and the names of the
    others, which are said. Raises CaptureError where none is there, or as `outputs_of`."""
    found, missing = find_scenes(table, data)
    if missing:
        fetches = dict.fromkeys(scene.fetch for scene in missing)
        typed = ", ".join(f"`desplat-fetch-data {name} --folder {data}`" for name in fetches)
        folders = list_names(dict.fromkeys(scene.folder for scene in missing), 12)
        said = f"Not in '{data}': {folders}. Fetch what is missing: {typed}."
        if not found:
            raise CaptureError(said)
        announce(said, warning=True)
    if smoke is not None:
        found = [smaller(scene, smoke.side) for scene in found]
    contents = {
        scene: content_of(outputs_of(scene, "train"), outputs_of(scene, "test")) for scene in found
    }
    return contents, [scene.name for scene in missing]


def find_scenes(table: Table, data: Path) -> tuple[list[PaperScene], list[PaperScene]]:
    """Scenes of a table whose folders are there, with their places, and those that are missing."""
    found, missing = [], []
    for scene in table.scenes:
        names = (scene.folder, scene.folder.replace("_", "-"))
        folder = scene.data_set.name  # some archives have another of their own name in it
        homes = (data / folder, data / folder / folder, data)
        places = (home / name for home in homes for name in names)
        place = next((place for place in places if place.is_dir()), None)
        if place is None:
            missing.append(scene)
        else:
            found.append(replace(scene, place=place.resolve()))
    return found, missing


def outputs_of(scene: PaperScene, split: str) -> Any:
    """nerfstudio's DataparserOutputs of a split. Raises CaptureError, which names the scene, where
    it cannot be read, or no photo is in it."""
    try:
        return splits_of("desplat-paper", scene.place, scene.parser, split)[0]
    except CaptureError as error:
        raise CaptureError(
            f"{scene.data_set.name}, {scene.name}: {error} Where the data set is not whole, move "
            f"'{scene.place.parent}' away and fetch the data set again."
        ) from error


def smaller(scene: PaperScene, side: int) -> PaperScene:
    """The same with photos of at most `side` pixels a side. Raises CaptureError as `outputs_of`."""
    cameras = outputs_of(replace(scene, downscale=1), "train").cameras
    longest = int(max(cameras.width.max(), cameras.height.max()))
    return replace(scene, downscale=2 ** max(0, math.ceil(math.log2(longest / side))))


# --- the table -----------------------------------------------------------------------------------

Cell = dict[str, Any]
"""A figure of a method on a scene or on `MEAN`: `scene`, `method`, `metric`, `values` (one for each
seed that is done), `mean`, `paper`, `difference` (ours less the paper's). The last two are None
where the paper has no figure, and in a smoke run."""


def cells_of(grid: Grid) -> dict[tuple[str, str, str], Cell]:
    """All figures that there are, and their means where a seed has all scenes of the table; by
    metric, method and scene."""
    published = {} if grid.smoke else figures_of(grid.table.name)
    scenes = [scene.name for scene in grid.contents]
    is_whole = grid.smoke is not None or len(scenes) == len(grid.table.scenes)

    def value(metric: Metric, key: tuple[str, str, int]) -> float | None:
        record = grid.records.get(grid.runs[key].key)
        return None if record is None else metric.of(record.scores)

    cells: dict[tuple[str, str, str], Cell] = {}
    for metric, method in product(grid.table.metrics, grid.methods):
        columns = {
            scene: [value(metric, (scene, method.name, seed)) for seed in grid.seeds]
            for scene in scenes
        }
        if is_whole and len(scenes) > 1:
            by_seed = zip(*columns.values(), strict=True)
            columns[MEAN] = [None if None in values else fmean(values) for values in by_seed]
        for name, values in columns.items():
            if known := [value for value in values if value is not None]:
                mean, paper = fmean(known), published.get((method.paper, name, metric.name))
                cells[metric.name, method.name, name] = {
                    "scene": name,
                    "method": method.name,
                    "metric": metric.name,
                    "values": known,
                    "mean": mean,
                    "paper": paper,
                    "difference": None if paper is None else mean - paper,
                }
    return cells


def write_table(grid: Grid) -> None:
    """Write table.md and table.json. Raises ConfigError where it cannot."""
    cells = cells_of(grid)
    scenes = [f"{s.name} ({' '.join(s.parser)}: {what})" for s, what in grid.contents.items()]
    methods = [f"{m.name} ({' '.join(('ns-train', m.method, *m.options))})" for m in grid.methods]
    conditions = {
        "the paper's LPIPS net": [LPIPS_NET],
        "scenes": scenes,
        "methods": methods,
        "seeds": list(grid.seeds),
        "steps": sorted({run.steps for run in grid.runs.values()}),
        **conditions_of(grid.done),
    }
    content = {"table": grid.table.name, "smoke": grid.smoke is not None}
    content |= {"cells": [*cells.values()], "conditions": conditions}
    content |= {"missing scenes": grid.missing, "failed": grid.failed}
    text = template(TEMPLATE).render(
        grid=grid,
        cells=cells,
        columns=list(dict.fromkeys(scene for _, _, scene in cells)),
        mean=MEAN,
        published={} if grid.smoke else figures_of(grid.table.name),
        conditions=conditions,
    )
    with plain_errors(grid.folder), whole_folder(grid.folder) as draft:
        (draft / "table.md").write_text(text, "utf8")
        (draft / "table.json").write_text(json.dumps(content, indent=1) + "\n", "utf8")
