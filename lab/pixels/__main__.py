"""Measure what exactness costs at a capture's size, and write docs/results/dials.md.

python -m lab.pixels NAME --size GAUSSIANS WIDTH HEIGHT     every dial of every backend
python -m lab.pixels NAME --run config.yml     steps for the embedding of a trained run's photos
python -m lab.pixels                           the page alone
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from desplat_ns.calibration.scenes import make_scene
from lab.arguments import parser_of
from lab.pixels.dial_study import measure_dials
from lab.pixels.embedding_steps import scores
from lab.pixels.report import enter, write_report


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = parser_of("python -m lab.pixels", __doc__)
    parser.add_argument("name", nargs="?", help="of the capture, in the page")
    parser.add_argument("--size", nargs=3, type=int, metavar=("GAUSSIANS", "WIDTH", "HEIGHT"))
    parser.add_argument("--seconds", type=float, default=180.0, help="for dials (%(default)s)")
    parser.add_argument("--run", type=Path, help="config.yml of a trained run")
    parser.add_argument("--setting", default="desplat", help="what the run is called (%(default)s)")
    chosen = parser.parse_args(arguments)
    if (chosen.size or chosen.run) and not chosen.name:
        parser.error("give the capture's name")
    if chosen.size:
        dials = measure_dials(make_scene(*chosen.size), chosen.seconds, print)
        enter(chosen.name, "dials", asdict(dials))
    if chosen.run:
        graded = [asdict(score) for score in scores(chosen.run, chosen.setting)]
        enter(chosen.name, "embedding", graded)
    print(f"written: {write_report()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
