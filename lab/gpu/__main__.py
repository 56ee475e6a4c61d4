"""Measure on a GPU what only a GPU can answer, and write docs/results/gpu.md.

make gpu                        in the environment of `make env`
make gpu WHEELS=folder          on a machine without a network, from a folder of wheels
make gpu GPU_ARGS='--device cpu --quick --output folder'     a rehearsal without a GPU

What the same commit measured on the same GPU before is kept: a second call does what is missing.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from lab.arguments import parser_of
from lab.documents import RESULTS
from lab.gpu.plan import KERNELS, PARTS, PATIENCE, TOTAL, Job, Part, with_time_to_compile
from lab.gpu.records import FILE, Run
from lab.gpu.report import PICTURE, write_report
from lab.gpu.runner import Runner

NO_GPU = 2
"""Exit status where there is no GPU to measure on."""

INCOMPLETE = 3
"""Exit status where the document is written and a part was not measured."""


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_of("python -m lab.gpu", __doc__)
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda", help="(%(default)s)")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: a check only")
    parser.add_argument("--output", type=Path, help="folder for gpu.md and gpu.json (docs/results)")
    names = [part.name for part in PARTS]
    parser.add_argument(
        "--again", action="store_true", help="measure what was measured before, too"
    )
    parser.add_argument("--only", nargs="+", default=names, choices=names, help="these parts")
    parser.add_argument(
        "--seconds", type=float, help=f"for everything together ({TOTAL:g}; a rehearsal has more)"
    )
    parser.add_argument(
        "--started", type=float, help="since when they count, seconds since 1970 (now)"
    )
    chosen = parser.parse_args(arguments)
    stand_in = chosen.quick or chosen.device == "cpu"
    output = RESULTS if chosen.output is None else chosen.output.resolve()
    if stand_in and output == RESULTS:
        parser.error(
            "a rehearsal (--device cpu, --quick) measures nothing to keep: name a folder other "
            "than docs/results with --output"
        )
    chosen.output = output
    chosen.is_stand_in = stand_in
    if chosen.seconds is None:
        chosen.seconds = PATIENCE * TOTAL if stand_in else TOTAL
    if chosen.started is not None:
        chosen.seconds -= max(0.0, time.time() - chosen.started)
    return chosen


def chosen_parts(names: Sequence[str], job: Job) -> list[Part]:
    """The parts of these names; on a GPU the kernels as well where one of them draws with them."""
    parts = [part for part in PARTS if part.name in names]
    if not job.is_stand_in and any(part.needs_kernels for part in parts):
        parts = [part for part in PARTS if part in parts or part == KERNELS]
    return parts


def gone_on_with(output: Path, job: Job) -> Run:
    """A run with the records of an earlier one in the same folder, if that was on the same GPU and
    of the same code."""
    import torch

    from desplat_ns.studies.machine import code_version

    where = job.device if job.is_stand_in else torch.cuda.get_device_name(0)
    run, path = Run(job.device, job.quick, made_by=f"{code_version()} on {where}"), output / FILE
    if path.exists():
        run.parts = run.goes_on(Run.load(path))
    return run


def no_gpu() -> str | None:
    """Why there is no GPU to measure on and what to do; None where there is one."""
    import torch  # takes seconds: not for `--help`

    if torch.cuda.is_available():
        return None
    built = f"built for CUDA {torch.version.cuda}" if torch.version.cuda else "built without CUDA"
    return (
        f"torch {torch.__version__} ({built}) sees no GPU, and nothing was measured. Run `make "
        "gpu` on a machine whose `nvidia-smi` shows one; if it does, install a torch for that "
        "driver. A rehearsal without a GPU, whose figures mean nothing: "
        "make gpu GPU_ARGS='--device cpu --quick --output folder'"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    chosen = parse_arguments(arguments)
    if chosen.device == "cuda":
        reason = no_gpu()
        if reason is not None:
            print(f"Error: {reason}", file=sys.stderr)
            return NO_GPU
    output: Path = chosen.output
    output.mkdir(parents=True, exist_ok=True)

    with tempfile.TemporaryDirectory(prefix="desplat-gpu-") as work:
        job = Job(chosen.device, chosen.quick, work)

        def written(run: Run) -> None:
            run.save(output)
            write_report(run, output)
            for picture in job.folder.glob("training.real/*.png"):
                shutil.copyfile(picture, output / PICTURE)

        run = gone_on_with(output, job)
        if chosen.again:
            run.parts = {}
        parts = chosen_parts([name for name in chosen.only if name not in run.parts], job)
        seconds = chosen.seconds
        if chosen.is_stand_in:
            parts = [part.patient() for part in parts]
        else:
            before = sum(part.deadline for part in parts)
            parts = [with_time_to_compile(part) if part == KERNELS else part for part in parts]
            seconds += sum(part.deadline for part in parts) - before
        run = Runner(job, seconds, written, say, parts, run)()
    missing = [name for name, record in run.parts.items() if not record.is_measured]
    print(f"Written: gpu.md and gpu.json. Not measured: {', '.join(missing) or 'nothing'}.")
    return INCOMPLETE if missing else 0


def say(line: str) -> None:
    """Print at once, also into a pipe."""
    print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
