"""Forward and forward + backward of every contender on one scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from desplat_ns.backend.protocol import Rendering, RenderSettings
from desplat_ns.calibration.scenes import Scene, tensors_of
from desplat_ns.calibration.timing import Timing, threads, time_in_turns
from lab.pixels.contenders import (
    Contender,
    cotangents,
    images_of,
    tensors_of_projected,
)

SETTINGS = RenderSettings(depth=True)
"""RGB, depth and alpha in one pass. No absgrad: the yardstick has none."""

WHOLE, BLENDING = "whole call", "blending alone"
"""The rasterizer as it is called; and what is left of it with projection and lists held ready."""


@dataclass(frozen=True)
class Row:
    """One contender's times on one scene."""

    scene: str
    contender: str
    part: str
    threads: int
    forward: Timing
    both: Timing
    """Forward + backward."""


def time_rasterizers(
    scene: Scene, contenders: list[Contender], number: int, rounds: tuple[int, int]
) -> list[Row]:
    """Time all contenders in turns with `number` threads.

    Args:
        rounds: of the fast cases, and of the slow ones (see `time_in_turns`).
    """
    cases: dict[str, Callable[[], object]] = {}
    keys: list[tuple[Contender, str]] = []
    for contender in contenders:
        for part in (WHOLE, BLENDING) if contender.has_seams else (WHOLE,):
            keys.append((contender, part))
            make = _whole if part == WHOLE else _blending
            forward, both = make(contender, scene)
            cases[f"{contender.name} {part} f"] = forward
            cases[f"{contender.name} {part} f+b"] = both
    with threads(number):
        timings = time_in_turns(cases, *rounds)
    return [
        Row(
            scene.name,
            contender.name,
            part,
            number,
            timings[f"{contender.name} {part} f"],
            timings[f"{contender.name} {part} f+b"],
        )
        for contender, part in keys
    ]


Cases = tuple[Callable[[], object], Callable[[], object]]


def forward_and_both(
    render: Callable[[], Rendering], leaves: list[Tensor], device: str = "cpu"
) -> Cases:
    """Two functions: render without gradients; render and pull random gradients back to leaves."""
    with torch.no_grad():
        factors = cotangents(images_of(render()))

    def wait() -> None:
        if device != "cpu":
            torch.cuda.synchronize()

    def forward() -> None:
        with torch.no_grad():
            render()
        wait()

    def both() -> None:
        images = images_of(render())
        # Whoever ignores a leaf (the blending of RGB has no use for radii, say) is not to fail.
        torch.autograd.grad(images, leaves, factors, allow_unused=True)
        wait()

    return forward, both


def _whole(contender: Contender, scene: Scene) -> Cases:
    splats, view = scene.splats(device=contender.device), scene.view_as(device=contender.device)
    return forward_and_both(
        lambda: contender.rasterizer(splats, view, SETTINGS), tensors_of(splats), contender.device
    )


def _blending(contender: Contender, scene: Scene) -> Cases:
    splats, view = scene.splats(), scene.view
    projected, lists = contender.parts(splats, view, SETTINGS)

    def render() -> Rendering:
        with contender.with_parts(projected, lambda *_: lists):
            return contender.rasterizer(splats, view, SETTINGS)

    return forward_and_both(render, tensors_of_projected(projected))
