"""Every table of `desplat-reproduce` from end to end on generated scenes, in minutes on a CPU.

    python -m lab.reproduce.smoke [--folder FOLDER] [--tables A5 A6] [--processes 2]

Scenes lie as the published ones do (`data_sets`) and all methods are trained on all of them, a few
steps at 48 pixels. A figure that a table lacks is an error.
"""

import argparse
import json
import shutil
import sys
import time
from multiprocessing import get_context
from pathlib import Path

from desplat_ns.core.console import announce, time_in_words
from desplat_ns.tools.studies.paper import METHODS, TABLES, TableName
from desplat_ns.tools.studies.reproduce import Smoke, reproduce
from lab.reproduce.data_sets import write_data_sets

FOLDER = Path("outputs/smoke")

SHORT = Smoke(steps=100, side=48)

GROUPS: tuple[tuple[TableName, ...], ...] = (
    ("robustnerf", "on-the-go", "A7"),
    ("A5", "A6"),
)
"""What goes into one output folder: A7 shares the runs of the first two."""


def run_tables(folder: Path, names: tuple[TableName, ...]) -> list[str]:
    """What went wrong, in words; says how long each table took."""
    wrong = []
    for name in names:
        table, began, wall = TABLES[name], time.process_time(), time.monotonic()
        methods = tuple(METHODS[method] for method in table.methods)
        places = (folder / "data", folder / f"tables-{names[0]}")
        made = reproduce(table, *places, methods, 1, SHORT)
        wrong += missing_figures(name, made)
        seconds, wall = time.process_time() - began, time.monotonic() - wall
        announce(f"{name}: {seconds:.0f} s of CPU time, {wall:.0f} s on the clock.")
    return wrong


def missing_figures(name: TableName, folder: Path) -> list[str]:
    """Which figures a written table lacks, but for LPIPS where its weights cannot be had."""
    table, content = TABLES[name], json.loads((folder / "table.json").read_text())
    there = {(cell["scene"], cell["method"], cell["metric"]) for cell in content["cells"]}
    has_lpips = bool(content["conditions"]["LPIPS net"])
    return [
        f"{name} has no {metric.name} of {method} on {scene.name}."
        for metric in table.metrics
        for method in table.methods
        for scene in table.scenes
        if (scene.name, method, metric.name) not in there
        and (metric.name != "lpips" or has_lpips)
        and (metric.name != "distractor_memory_mb" or method.startswith("desplat"))
    ]


def main() -> int:
    """Entry point; 1 if a figure is missing."""
    parser = argparse.ArgumentParser(description="Every table, on generated scenes.")
    parser.add_argument("--folder", type=Path, default=FOLDER)
    parser.add_argument("--tables", nargs="+", choices=TABLES, default=list(TABLES))
    parser.add_argument("--processes", type=int, choices=(1, 2), default=2)
    options = parser.parse_args()
    began = time.monotonic()
    if options.folder != FOLDER and options.folder.exists():
        parser.error(f"--folder {options.folder} is there already: name a new one.")
    shutil.rmtree(FOLDER, ignore_errors=True)
    write_data_sets(options.folder / "data")
    groups = [tuple(name for name in group if name in options.tables) for group in GROUPS]
    tasks = [(options.folder, group) for group in groups if group]
    with get_context("spawn").Pool(options.processes) as pool:
        wrong = [line for lines in pool.starmap(run_tables, tasks) for line in lines]
    for line in wrong:
        announce(line, warning=True)
    announce(f"{options.folder}: {time_in_words(time.monotonic() - began)} on the clock.")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
