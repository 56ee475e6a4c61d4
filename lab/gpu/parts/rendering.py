"""Frames per second of a scene that is shown, and of one that is shown and scored.

The paper's rates (its table A9) include the metrics of every frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from desplat_ns.calibration.scenes import Scene, make_scene
from desplat_ns.calibration.timing import time_in_turns
from desplat_ns.rendering.metrics import LazyLpips, image_metrics
from lab.gpu.plan import Job
from lab.gpu.records import Figures
from lab.gpu.scenes import (
    NONE_PLACED,
    PLACED,
    PLAIN,
    QUICK_SIZES,
    SIZES,
    SPLATFACTO,
    all_steps,
)
from lab.gpu.spread import summary
from lab.gpu.stand_in import splatfacto_on

ROUNDS, QUICK_ROUNDS = 20, 1

WEIGHTS = "hub/checkpoints/alexnet-owt-7be5be79.pth"
"""Of LPIPS's network, in torch's folder: never fetched here."""

NAMES = {
    SPLATFACTO: "Splatfacto",
    PLAIN: "DeSplat, the static scene",
    PLACED: "DeSplat, a training view with 1,000 distractors",
}


def measure(job: Job) -> Iterator[Figures]:
    """Rates of all cases, with metrics and without, size after size."""
    rows: list[dict[str, Any]] = []
    lpips = LazyLpips() if Path(torch.hub.get_dir()).parent.joinpath(WEIGHTS).exists() else None
    scored = "PSNR, SSIM" + ", LPIPS" * (lpips is not None)
    for size in QUICK_SIZES if job.quick else SIZES:
        scene = make_scene(*size)
        with splatfacto_on(job.device):
            rows += _rates(job, scene, lpips)
        yield {"rows": rows, "metrics": scored}


def _rates(job: Job, scene: Scene, lpips: LazyLpips | None) -> list[dict[str, Any]]:
    cases: dict[str, Callable[[], object]] = {}
    for name, step in all_steps(job, scene).items():
        if name == NONE_PLACED:
            continue  # draws what PLAIN does
        step.model.eval()
        draw = _drawing(step.model, step.camera)
        cases[f"{name}|drawn"] = draw
        cases[f"{name}|scored"] = _scored(draw, step.photo, lpips)
    timings = time_in_turns(cases, QUICK_ROUNDS if job.quick else ROUNDS)
    rows = []
    for key, timing in timings.items():
        name, _, what = key.partition("|")
        rates = summary([1000 / ms for ms in timing.wall])
        rows.append({"scene": scene.name, "case": NAMES[name], "what": what, "fps": rates})
    return rows


def _drawing(model: Any, camera: Any) -> Callable[[], Tensor]:
    """A frame on the device, finished."""

    def draw() -> Tensor:
        with torch.no_grad():
            outputs = model.get_outputs_for_camera(camera)
        frame = outputs.get("rgb_composite", outputs["rgb"])
        if frame.is_cuda:
            torch.cuda.synchronize()
        return frame

    return draw


def _scored(
    draw: Callable[[], Tensor], photo: Tensor, lpips: LazyLpips | None
) -> Callable[[], dict[str, float]]:
    def score() -> dict[str, float]:
        with torch.no_grad():
            return image_metrics(draw(), photo, lpips)

    return score
