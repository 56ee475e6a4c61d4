"""`desplat-reproduce`: every method on every scene of a table with every seed, and the table in
files: means over seeds, the paper's figures beside them, and the conditions."""

import json
import math
import re
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from desplat_ns.core.console import about, announce, list_names
from desplat_ns.core.errors import CaptureError, DeSplatError
from desplat_ns.core.pages import template
from desplat_ns.core.whole import only_process_in, plain_errors, whole_folder
from desplat_ns.metrics import lpips_weights
from desplat_ns.tools.studies.methods import content_of, method_config, splits_of
from desplat_ns.tools.studies.paper import LPIPS_NET, MEAN, Method, PaperScene, Table, figures_of
from desplat_ns.tools.studies.records import Key, Record, conditions_of, open_records
from desplat_ns.tools.studies.runs import Run, finish

TEMPLATE = Path(__file__).with_name("table.md.jinja")


class Smoke(NamedTuple):
    """How a run is cut short that measures nothing: steps, and pixels of the longer side."""

    steps: int = 100
    side: int = 160


@dataclass
class Grid:
    """What a table is made of."""

    table: Table
    scenes: dict[PaperScene, str]
    """Those that are there, and what is in them, in words."""
    missing: list[str]
    """Names of the others."""
    methods: tuple[Method, ...]
    seeds: range
    smoke: Smoke | None
    """How runs are cut short; None: they are not."""

    def __post_init__(self) -> None:
        self.runs = {
            (scene.name, method.name, seed): run_of(scene, method, seed, self.smoke)
            for seed, scene, method in product(self.seeds, self.scenes, self.methods)
        }

    @property
    def published(self) -> dict[tuple[str, str, str], float | None]:
        """The paper's figures, with which those of a smoke run are not compared."""
        return {} if self.smoke else figures_of(self.table.name)


def run_of(scene: PaperScene, method: Method, seed: int, smoke: Smoke | None = None) -> Run:
    """A cell of the grid as it is trained."""
    steps, options = scene.steps, method.options
    if smoke is not None:  # whose photos are small enough
        steps, options = smoke.steps, (*options, "--pipeline.model.num-downscales", "0")
    if hasattr(method_config(method.method).pipeline, "evaluation"):
        has_no_light = scene.scoring == "half" and not method.has_light
        protocol = "right" if has_no_light else scene.scoring
        options += ("--pipeline.evaluation.protocol", protocol)
        options += ("--pipeline.evaluation.lpips-net", LPIPS_NET)
    name = re.sub("[^a-z0-9]+", "-", scene.name.lower()).strip("-")
    variant = f"{scene.data_set}.{name}.{method.name}"
    return Run(variant, method.method, options, steps, seed, scene.place, scene.parser)


def reproduce(
    table: Table,
    data: Path,
    output: Path,
    methods: tuple[Method, ...],
    seeds: int,
    smoke: Smoke | None = None,
) -> Path:
    """Run what a table needs of the data sets in a folder, and write it; the folder that holds it.
    Raises DeSplatError, also where runs failed; the table is written without them."""
    with only_process_in(output):
        records = open_records(output)
        contents = find_contents(table, data, smoke)
        grid = Grid(table, *contents, methods, range(42, 42 + seeds), smoke)
        runs = grid.runs.values()

        def left() -> str:
            done = [records[run.key].seconds for run in runs if run.key in records]
            seconds = (len(runs) - len(done)) * fmean(done)
            return f"Runs left: {len(runs) - len(done)}, {about(seconds)}."

        done = sum(run.key in records for run in runs)
        announce(f"{table.title}. Runs: {len(runs)}; done: {done}.")
        for scene, content in grid.scenes.items():
            announce(f"    {scene.name}: {content}; {scene.place}")
        weights = lpips_weights(LPIPS_NET)
        if done < len(runs) and not weights.is_file():  # hours later is too late
            announce(
                f"LPIPS's weights are not at {weights}: they are fetched with the first score. "
                "Where there is no network, copy them there first; else LPIPS is left out.",
                warning=True,
            )
        failed = finish(runs, records, output, left)
        folder = output / (table.name + "-smoke" * (smoke is not None))
        write_table(grid, records, failed, folder)
    if failed:
        raise DeSplatError(
            f"{len(failed)} of {len(runs)} runs failed: {list_names(failed)}. '{folder}' has the "
            "table without them; the same command tries them again."
        )
    return folder


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
        home = data / scene.data_set  # some archives have another folder of their own name in it
        names = (scene.folder, scene.folder.replace("_", "-"))
        places = (at / name for at in (home, home / home.name, data) for name in names)
        place = next((place for place in places if place.is_dir()), None)
        if place is None:
            missing.append(scene)
        else:
            found.append(replace(scene, place=place.resolve()))
    return found, missing


def outputs_of(scene: PaperScene, split: str) -> Any:
    """nerfstudio's DataparserOutputs of a split. Raises CaptureError, which names the scene."""
    try:
        return splits_of("desplat-paper", scene.place, scene.parser, split)[0]
    except CaptureError as error:
        raise CaptureError(
            f"{scene.data_set}, {scene.name}: {error} Where the data set is not whole, move "
            f"'{scene.place.parent}' away and fetch the data set again."
        ) from error


def smaller(scene: PaperScene, side: int) -> PaperScene:
    """The same with photos of at most `side` pixels a side. Raises CaptureError as `outputs_of`."""
    cameras = outputs_of(replace(scene, downscale=1), "train").cameras
    longest = int(max(cameras.width.max(), cameras.height.max()))
    return replace(scene, downscale=2 ** max(0, math.ceil(math.log2(longest / side))))


def cells_of(grid: Grid, records: dict[Key, Record]) -> dict[tuple[str, str, str], dict[str, Any]]:
    """All figures, and means where a seed has all scenes; by metric, method and scene. `values` are
    those of the seeds, `paper` is None where the paper has no figure."""
    scenes = [scene.name for scene in grid.scenes]
    is_whole = grid.smoke is not None or not grid.missing
    done = {at: records[run.key].scores for at, run in grid.runs.items() if run.key in records}
    cells: dict[tuple[str, str, str], dict[str, Any]] = {}
    for metric, method in product(grid.table.metrics, grid.methods):
        columns = {
            scene: [
                done.get((scene, method.name, seed), {}).get(metric.name) for seed in grid.seeds
            ]
            for scene in scenes
        }
        if is_whole and len(scenes) > 1:
            by_seed = zip(*columns.values(), strict=True)
            columns[MEAN] = [None if None in values else fmean(values) for values in by_seed]
        for name, values in columns.items():
            if known := [value for value in values if value is not None]:
                cell = {"scene": name, "method": method.name, "metric": metric.name}
                mean, paper = fmean(known), grid.published.get((method.paper, name, metric.name))
                cell |= {"values": known, "mean": mean, "paper": paper}
                cells[metric.name, method.name, name] = cell
    return cells


def write_table(
    grid: Grid, records: dict[Key, Record], failed: dict[str, str], folder: Path
) -> None:
    """Write table.md and table.json. Raises ConfigError where it cannot."""
    cells = cells_of(grid, records)
    conditions = {
        "the paper's LPIPS net": [LPIPS_NET],
        "scenes": [f"{s.name} ({' '.join(s.parser)}: {what})" for s, what in grid.scenes.items()],
        "methods": [f"{m.name}: ns-train {' '.join((m.method, *m.options))}" for m in grid.methods],
        "seeds": list(grid.seeds),
        "steps": sorted({run.steps for run in grid.runs.values()}),
        **conditions_of(records[r.key] for r in grid.runs.values() if r.key in records),
    }
    content = {"table": grid.table.name, "smoke": grid.smoke is not None}
    content |= {"cells": [*cells.values()], "conditions": conditions}
    content |= {"missing scenes": grid.missing, "failed": failed}
    columns = list(dict.fromkeys(scene for _, _, scene in cells))
    text = template(TEMPLATE).render(
        grid=grid, cells=cells, columns=columns, mean=MEAN, failed=failed, conditions=conditions
    )
    with plain_errors(folder), whole_folder(folder) as draft:
        (draft / "table.md").write_text(text, "utf8")
        (draft / "table.json").write_text(json.dumps(content, indent=1) + "\n", "utf8")
