"""Fig. 9 left on photos at hand: `fox_cluttered` with 0 to 100% of its viewpoints cluttered.

    DESPLAT_NS_DATA=<folder> python -m lab.reproduce.fig9 [--steps 1000] [--methods desplat]

Goes on where it was ended, and writes the page once all is done. Runs share this process and one
thread; `outputs/fig9-fox` keeps them.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

from desplat_ns.reproduce.grid import Request, open_grid
from desplat_ns.reproduce.methods import METHODS, Method, method_of
from desplat_ns.reproduce.protocols import RATIOS, ROBUSTNERF_RATIOS, Scene
from desplat_ns.reproduce.tables import IMAGES, MEMORY, TIME, Table
from desplat_ns.reproduce.writing import write_table
from lab.documents import OUTPUTS, RECORDS, RESULTS
from lab.reproduce.here import InThisProcess

NAME = "fig9-fox"
KEPT = {"table.md": RESULTS / f"{NAME}.md", "table.json": RECORDS / "fig9_fox.json"}

METHODS_COMPARED = (
    *(METHODS["desplat"], METHODS["desplat-paper"], METHODS["splatfacto"]),
    replace(
        method_of("lab.reproduce.baselines:by_residual"),
        name="robust",
        what="Splatfacto on the 80% of a photo's pixels that it fits best, RobustNeRF's way",
    ),
    replace(
        method_of("lab.reproduce.baselines:by_truth"),
        name="true-masks",
        what="Splatfacto without the pixels of the things in the way, which no method can know",
    ),
)


def table_of(steps: int, methods: tuple[Method, ...]) -> Table:
    """The table: one column for each share."""
    options = "--train-split-clean-clutter-ratio"
    scenes = tuple(
        Scene(f"{100 * ratio:.0f}%", "fox_cluttered", 2, "", (options, str(ratio)), f"fox-{ratio}")
        for ratio in RATIOS
    )
    protocol = replace(
        ROBUSTNERF_RATIOS,
        name=NAME,
        title="fox_cluttered, by the share of cluttered viewpoints",
        folder="",
        steps=steps,
        methods=tuple(method.name for method in methods),
        said="None: these photos are not the paper's. 40 viewpoints of NVIDIA's fox with "
        "distractors pasted in; the 10 clean photos `extra` are scored, whole.",
        scenes=scenes,
    )
    note = (
        "Fig. 9 left asks how much a method loses as more of its photos are cluttered. "
        "`splatfacto` and `desplat-paper` have the paper's schedules, the others this package's: "
        "in few steps that alone makes a difference, as 0% shows. Compare each with itself along "
        "its row. `robust` leaves out a fifth of every photo: where nothing is in the way, that "
        "is the scene's own detail. `true-masks` is no method but what perfect masks would give."
    )
    metrics = (*IMAGES, *TIME, *MEMORY)
    return Table(
        "fig9", f"Fig. 9 left on fox_cluttered, {steps:,} steps", (protocol,), metrics, note
    )


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description="Fig. 9 left on fox_cluttered.")
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--seeds", type=int, default=1)
    names = [method.name for method in METHODS_COMPARED]
    parser.add_argument("--methods", nargs="+", choices=names, default=names)
    options = parser.parse_args()
    methods = tuple(method for method in METHODS_COMPARED if method.name in options.methods)
    output, data = OUTPUTS / NAME, Path(os.environ["DESPLAT_NS_DATA"])
    arguments = (table_of(options.steps, methods), data, output, methods, options.seeds)
    request = Request(*arguments, InThisProcess(), 1, "cpu")
    grid = open_grid(request)
    grid.do()
    write_table(request.folder, grid.results())
    for name, kept in KEPT.items():
        text = (request.folder / name).read_text("utf8")
        kept.write_text(text.replace(str(Path.home()), "~"), "utf8")


if __name__ == "__main__":
    main()
