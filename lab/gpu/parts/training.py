"""The generated scene trained and scored, on the CPU and on the GPU; a real one on the GPU."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from desplat_ns.errors import DeSplatError
from desplat_ns.studies.runs import QUIET
from desplat_ns.studies.train_and_score import train_and_score
from lab.gpu.plan import Job
from lab.gpu.records import Figures
from lab.synthetic import SceneSpec, write_scene

STEPS, QUICK_STEPS = 1_000, 20

REAL, REAL_STEPS = "fox_cluttered", 3_000
"""A real capture in the folder that DESPLAT_NS_DATA names, at half the size of its photos: what
docs/results/quality.md has of it is of the CPU."""

PICTURE = "worst.png"
"""Of the held-out view that is rendered worst, in the part's folder: its photo beside it."""

KEPT = (
    *("psnr", "ssim", "mask_iou", "train_wall_seconds", "train_cpu_seconds"),
    *("num_images", "num_masks", "num_static_gaussians", "num_distractor_gaussians", "backend"),
)
"""Of the figures of an evaluation."""


def measure(job: Job) -> Iterator[Figures]:
    """Train with every setting as registered, and score what was held out.

    Raises:
        DeSplatError: the real capture is asked for, and nobody says where it is.
    """
    device = "cpu" if job.case == "cpu" or job.is_stand_in else "cuda"
    if device == "cpu":  # what is compiled once is no part of a training
        command = [sys.executable, "-m", "desplat_ns.backend.compile_kernels", "numba"]
        subprocess.run(command, check=True)
    steps = REAL_STEPS if job.case == "real" else STEPS
    runs = job.folder / f"training.{job.case}"
    options = ["--max-num-iterations", str(QUICK_STEPS if job.quick else steps)]
    options += ["--machine.device-type", device]
    options += ["--pipeline.model.backend", "numba" if device == "cpu" else "gsplat"]
    options += ["--output-dir", str(runs), *QUIET, "robustnerf-data"]
    options += real_capture() if job.case == "real" else ["--data", str(capture(job))]
    figures = train_and_score("desplat", options, runs / "pictures")["figures"]
    keep_the_worst(figures["images"], runs)
    yield {
        "capture": REAL if job.case == "real" else "generated",
        "device": device,
        "steps": QUICK_STEPS if job.quick else steps,
        "threads": torch.get_num_threads(),
        **{name: figures[name] for name in KEPT if name in figures},
    }


def real_capture() -> list[str]:
    """Options of the dataparser.

    Raises:
        DeSplatError: DESPLAT_NS_DATA names no folder that holds it.
    """
    folder = Path(os.environ.get("DESPLAT_NS_DATA", ""), REAL)
    if not folder.is_dir():
        raise DeSplatError(
            f"There is no {REAL}: set DESPLAT_NS_DATA to the folder that holds it, and run `make "
            "gpu` again."
        )
    return ["--data", str(folder), "--downscale-factor", "2"]


def keep_the_worst(images: Sequence[Mapping[str, Any]], runs: Path) -> None:
    """Copy the picture of the image whose PSNR is the lowest to where the report finds it."""
    worst = min(range(len(images)), key=lambda index: images[index]["psnr"])
    (picture,) = (runs / "pictures").glob(f"*_img_{worst:04d}.png")
    shutil.copyfile(picture, runs / PICTURE)


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
