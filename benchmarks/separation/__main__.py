"""Do the runs of the study that are missing, then write its document.

python -m benchmarks.separation --jobs 2        (or: make study; it resumes where it was stopped)
"""

from __future__ import annotations

import argparse
import fnmatch
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from typing import Any

from benchmarks.documents import OUTPUTS
from benchmarks.separation import records
from benchmarks.separation.execute import execute
from benchmarks.separation.report import write_report
from benchmarks.separation.runs import PLAN, Run
from desplat_ns.errors import DeSplatError

_lock = Lock()


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.separation",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--jobs", type=int, default=1, help="runs beside each other (%(default)s)")
    parser.add_argument(
        "--only", nargs="+", default=["*"], help="runs whose names match, e.g. '*-clutter-2-*'"
    )
    parser.add_argument("--list", action="store_true", help="name the missing runs and stop")
    parser.add_argument("--report", action="store_true", help="only write the document")
    parser.add_argument("--output", type=Path, default=OUTPUTS / "separation", help="of the runs")
    return parser.parse_args()


def wanted_runs(patterns: list[str], known: dict[str, dict[str, Any]]) -> list[Run]:
    """The runs that are not recorded, in the order of the patterns and of the plan."""
    named = {run: None for p in patterns for run in PLAN if fnmatch.fnmatch(run.name, p)}
    return [run for run in named if not records.is_done(run, known)]


def measure(run: Run, folder: Path) -> bool:
    """Do one run and keep its figures; False where it failed, which is said."""
    try:
        results = execute(run, folder)
    except DeSplatError as error:
        print(f"{run.name}: {error}", file=sys.stderr, flush=True)
        return False
    with _lock:
        records.add(run, results)
    print(f"{run.name}: {results['psnr']:.2f} dB, {results['train_cpu_seconds']:.0f} s", flush=True)
    return True


def main() -> int:
    """Entry point."""
    chosen = parse_arguments()
    known = records.load()
    missing = wanted_runs(chosen.only, known)
    if chosen.list:
        print("\n".join(r.name for r in missing))
        return 0
    done = [True]
    if not chosen.report:
        chosen.output.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(chosen.jobs) as pool:
            done = list(pool.map(lambda run: measure(run, chosen.output), missing))
    print(f"written: {write_report(records.load(), records.load(records.BEFORE))}")
    return 0 if all(done) else 1


if __name__ == "__main__":
    sys.exit(main())
