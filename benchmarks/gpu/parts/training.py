"""The generated scene trained and scored: on the CPU, and on the GPU."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import torch

from benchmarks.gpu.plan import Job
from benchmarks.gpu.records import Figures
from desplat_ns.studies.grid.commands import QUIET
from desplat_ns.studies.grid.train_and_score import train_and_score
from desplat_ns.synthetic import SceneSpec, write_scene

STEPS, QUICK_STEPS = 1_000, 20

KEPT = (
    *("psnr", "ssim", "mask_iou", "train_wall_seconds", "train_cpu_seconds"),
    *("num_images", "num_masks", "num_static_gaussians", "num_distractor_gaussians", "backend"),
)
"""Of the figures of an evaluation."""


def measure(job: Job) -> Iterator[Figures]:
    """Train with every setting as registered, and score what was held out."""
    device = "cuda" if job.case == "gpu" and not job.is_stand_in else "cpu"
    steps = QUICK_STEPS if job.quick else STEPS
    scene = capture(job)
    if device == "cpu":  # what is compiled once is no part of a training
        command = [sys.executable, "-m", "desplat_ns.backend.compile_kernels", "numba"]
        subprocess.run(command, check=True)
    runs = job.folder / f"training.{job.case}"
    options = ["--max-num-iterations", str(steps), "--machine.device-type", device]
    options += ["--pipeline.model.backend", "numba" if device == "cpu" else "gsplat"]
    options += ["--output-dir", str(runs), *QUIET]
    options += ["robustnerf-data", "--data", str(scene)]
    found = train_and_score("desplat", options, runs / "pictures")["figures"]
    yield {
        "device": device,
        "steps": steps,
        "threads": torch.get_num_threads(),
        **{name: found[name] for name in KEPT if name in found},
    }


def capture(job: Job) -> Path:
    """The scene's folder; the first part that asks for it writes it."""
    folder = job.folder / "scene"
    if folder.is_dir():
        return folder
    beside = Path(tempfile.mkdtemp(prefix="scene-", dir=job.folder))
    write_scene(spec(job.quick), beside)
    try:
        os.rename(beside, folder)
    except OSError:  # another part was faster
        shutil.rmtree(beside)
    return folder


def spec(quick: bool) -> SceneSpec:
    """The demo's scene; in a rehearsal eight small views, as few as distractors are found in."""
    if quick:
        return SceneSpec(num_views=8, num_extras=2, width=72, height=48, num_points=300)
    return SceneSpec()
