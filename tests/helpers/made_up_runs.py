"""Records of runs that nobody did."""

from pathlib import Path

from desplat_ns.tools.studies.machine import code_version
from desplat_ns.tools.studies.records import Record
from desplat_ns.tools.studies.runs import Run

CODE = code_version()


def made_up(run: Run, folder: Path) -> Record:
    """More dB with more steps, a little by variant and seed; a tenth of a second for each step."""
    extra = sum(map(ord, run.variant)) % 7 / 10 + (run.seed - 43) / 100
    scores = {
        "psnr": 10 + run.steps / 10_000 + extra,
        "ssim": 0.5,
        "lpips": 0.3,
        "static_memory_mb": 40.0 + extra,
        "distractor_memory_mb": 10.0,
        "num_static_gaussians": 1000,
        "train_wall_seconds": run.steps / 10,
        "backend": "gsplat",
    }
    return Record(CODE, "2026-11-27", *run.key, scores, 5 + run.steps / 10, "a device")
