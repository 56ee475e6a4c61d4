"""Pictures of trained runs: what stands in a training photo, and what became of it.

python -m lab.separation.sheet --runs desplat-white-2-3000-42 ...   (after make study)
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from desplat_ns.data.gt_masks import METADATA_KEY, read_gt_mask
from desplat_ns.errors import DeSplatError
from desplat_ns.evaluation.pictures import Picture, over_checkerboard, to_rgb8
from desplat_ns.runs.files import find_run
from desplat_ns.runs.loading import load_run
from lab.documents import OUTPUTS, RESEARCH
from lab.grid.runs import Run
from lab.separation.runs import HARD, PLAN, STUDY
from lab.sheet import sheet

TITLES = ("photo", "static scene", "distractors", "their mask", "true mask")
VIEW = 4
"""Training view that is drawn: early enough that the recurring occluder stands in it."""

HARD_RUNS = [Run("desplat", case, 2, 3000, 42).name for case in HARD]


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m lab.separation.sheet",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--runs", nargs="+", default=HARD_RUNS, help="names, as --list gives them")
    parser.add_argument("--view", type=int, default=VIEW, help="training view (%(default)s)")
    parser.add_argument("--trained", type=Path, default=OUTPUTS / "separation", help="of the study")
    parser.add_argument(
        "--output", type=Path, default=RESEARCH / "separation_hard.jpg", help="the sheet"
    )
    return parser.parse_args()


def trained_config(name: str, folder: Path) -> Path:
    """The config.yml of a run of the study.

    Raises:
        DeSplatError: there is no such run, or it has not been trained here.
    """
    known = {run.name: run for run in PLAN}
    if name not in known:
        raise DeSplatError(f"The study has no run '{name}'; `--list` of the study names them.")
    config = STUDY.config_of(known[name], folder)
    if not config.is_file():
        raise DeSplatError(
            f"'{name}' is not trained: there is no {config}. Train it with "
            f"`python -m lab.separation --only {name}`."
        )
    return config


def row(name: str, config: Path, view: int) -> tuple[str, list[Picture]]:
    """Training view number `view` of a run, its layers, and the true mask."""
    pipeline: Any = load_run(find_run(config)).pipeline
    manager: Any = pipeline.datamanager
    index = min(view, len(manager.train_dataset) - 1)
    camera = manager.train_dataset.cameras[index : index + 1].to(pipeline.device)
    outputs: Any = pipeline.model.get_outputs_for_camera(camera)
    drawn = {key: value.cpu().numpy() for key, value in outputs.items()}
    height, width = drawn["rgb_static"].shape[:2]
    truth = manager.train_dataparser_outputs.metadata[METADATA_KEY][index]
    return f"{name}: {manager.train_image_names[index]}", [
        manager.train_dataset[index]["image"].cpu().numpy(),
        drawn["rgb_static"],
        over_checkerboard(drawn["rgb_distractor"], drawn["alpha_distractor"]),
        drawn["distractor_mask"],
        read_gt_mask(truth, width, height).numpy(),
    ]


def main() -> int:
    """Entry point."""
    chosen = parse_arguments()
    try:
        rows = [
            row(name, trained_config(name, chosen.trained), chosen.view) for name in chosen.runs
        ]
    except DeSplatError as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    Image.fromarray(np.asarray(to_rgb8(sheet(rows, TITLES)))).save(chosen.output, quality=85)
    print(f"written: {chosen.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
