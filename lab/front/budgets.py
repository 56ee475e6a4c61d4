"""How well budgets of time are kept: train with each on each scene, and look at the clock outside.

    python -m lab.front.budgets 2min 5min 10min        (half an hour for each scene)

DESPLAT_NS_DATA names the folder with the scenes. What else the machine does is for you to say.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

from desplat_ns.studies.runs import QUIET, surroundings
from desplat_ns.training.checkpoint_files import load_newest
from lab.documents import OUTPUTS
from lab.front.kept import FILE, Kept
from lab.front.report import write_report

SCENES = {
    "monstree_cluttered": ("robustnerf-data", "--downscale-factor", "2"),
    "sacre_coeur": ("photo-tourism-data",),
    "fox_cluttered": ("robustnerf-data", "--downscale-factor", "2"),
}


def kept_in(folder: Path, scene: str, budget: str, beside: str, took: float) -> Kept:
    """Read what a finished run planned and did."""
    (models,) = folder.rglob("nerfstudio_models")
    saved = load_newest(models)[1]["budget"]
    state, done = saved["state"], saved["steps_done"]
    return Kept(scene, budget, beside, took, state["steps"], done, state["downscale"])


def run(scene: str, budget: str, beside: str) -> Kept:
    """Train on a scene within a budget. Raises CalledProcessError where that fails."""
    folder = OUTPUTS / "budgets" / f"{scene}-{budget}"
    shutil.rmtree(folder, ignore_errors=True)
    data = Path(os.environ["DESPLAT_NS_DATA"]) / scene
    places = ["--data", str(data), "--output-dir", str(folder)]
    train = [str(Path(sys.executable).with_name("ns-train")), "desplat", *places, *QUIET]
    started = time.monotonic()
    subprocess.run(
        [*train, "--budget", budget, *SCENES[scene]],
        check=True,
        env=surroundings(),
        stdout=subprocess.DEVNULL,
    )
    return kept_in(folder, scene, budget, beside, round(time.monotonic() - started, 1))


def enter(kept: Kept) -> None:
    """Add a run to the file, in place of an earlier one of the same kind."""
    runs = [Kept(**run) for run in json.loads(FILE.read_text("utf8"))] if FILE.exists() else []
    same = (kept.scene, kept.budget, kept.beside)
    others = [run for run in runs if (run.scene, run.budget, run.beside) != same]
    FILE.write_text(json.dumps([asdict(run) for run in (*others, kept)], indent=1) + "\n", "utf8")


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("budgets", nargs="+")
    parser.add_argument("--scenes", nargs="+", choices=[*SCENES], default=[*SCENES])
    parser.add_argument("--beside", default="nothing", help="what else the machine does")
    options = parser.parse_args()
    for budget in options.budgets:
        for scene in options.scenes:
            kept = run(scene, budget, options.beside)
            print(kept.row())
            enter(kept)
    write_report()


if __name__ == "__main__":
    main()
