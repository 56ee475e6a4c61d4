"""How far the GPU's pictures and gradients are from float64, beside those of the CPU's backends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict

import torch

from desplat_ns.backend import resolve
from desplat_ns.calibration.scenes import make_scene
from lab.gpu.plan import Job
from lab.gpu.records import Figures
from lab.pixels.accuracy import Errors, measure_errors
from lab.pixels.contenders import Contender, backends
from lab.pixels.dials import Setting, replacements, turned

SIZES = ((2_000, 160, 120), (20_000, 480, 270))
QUICK_SIZES = ((300, 64, 48),)

EXACT, SQUARES = "exact lists", "3-sigma squares"
"""What the reference draws: all that reaches the cutoff; or, as gsplat does, each Gaussian in the
tiles of its 3-sigma square only."""


def measure(job: Job) -> Iterator[Figures]:
    """Errors of every backend against both references, scene after scene.

    The references, and the torch and numba backends on the CPU with them, are cut to squares by
    `dials`; what draws by itself, gsplat, is what it is.
    """
    rows: list[dict[str, object]] = []
    for size in QUICK_SIZES if job.quick else SIZES:
        scene = make_scene(*size)
        for lists in (EXACT, SQUARES):
            with turned(_cut(lists)):
                rows += [_row(lists, errors) for errors in measure_errors(scene, contenders(job))]
            yield {"rows": rows}


def contenders(job: Job) -> list[Contender]:
    """Every backend that can run here, and torch's on the GPU as well."""
    runnable, _ = backends()
    if job.is_stand_in:
        return runnable
    return [*runnable, Contender("torch on CUDA", "cuda", resolve("torch", "cuda"))]


def _cut(lists: str) -> list:
    if lists == EXACT:
        return []
    drawing = {c.name: c for c in backends()[0]}
    cut = Setting(torch.float32, lists="squares")
    return [change for name in ("torch", "numba") for change in replacements(drawing[name], cut)]


def _row(lists: str, errors: Errors) -> dict[str, object]:
    return {"reference": lists, **asdict(errors)}
