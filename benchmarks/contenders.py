"""What is compared: every backend that can run here, and the yardstick."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any
from unittest import mock

import torch
from torch import Tensor

from benchmarks.yardstick import Yardstick
from benchmarks.yardstick_squares import SquaresYardstick
from desplat_ns.backend import Rasterizer, Rendering, registry, resolve
from desplat_ns.backend.projection import ProjectedSplats
from desplat_ns.backend.protocol import RenderSettings, Splats, View

YARDSTICK, SQUARES = Yardstick.name, SquaresYardstick.name

_SEAMS = {"numba": "_project", "torch": "project", YARDSTICK: "project", SQUARES: "project"}
"""The name under which a rasterizer's module calls the projection. All call lists `tile_lists`, so
that these two parts can be timed, or left out, without copying a rasterizer."""


@dataclass(frozen=True)
class Contender:
    """A rasterizer, and the device on which it draws."""

    name: str
    device: str
    rasterizer: Rasterizer

    @property
    def module(self) -> ModuleType:
        return importlib.import_module(type(self.rasterizer).__module__)

    @property
    def has_seams(self) -> bool:
        """Whether its parts can be timed one by one."""
        return self.name in _SEAMS

    def project(self, splats: Splats, view: View, settings: RenderSettings) -> ProjectedSplats:
        """Its own projection."""
        return getattr(self.module, _SEAMS[self.name])(splats, view, settings)

    @contextmanager
    def with_parts(
        self, projected: ProjectedSplats | None, lists: Callable[..., Any]
    ) -> Iterator[None]:
        """Within, the rasterizer takes `projected`, if given, and gets its lists from `lists`."""
        with mock.patch.object(self.module, "tile_lists", lists):
            if projected is None:
                yield
                return
            with mock.patch.object(self.module, _SEAMS[self.name], lambda *_: projected):
                yield

    def parts(
        self, splats: Splats, view: View, settings: RenderSettings
    ) -> tuple[ProjectedSplats, Any]:
        """Projected Gaussians as leaves, and their lists as the rasterizer makes them."""
        projected = as_leaves(self.project(splats, view, settings))
        made, kept = self.module.tile_lists, []

        def keep(*args: Any) -> Any:
            kept.append(made(*args))
            return kept[-1]

        with torch.no_grad(), self.with_parts(projected, keep):
            self.rasterizer(splats, view, settings)
        return projected, kept[0]


def contenders() -> tuple[list[Contender], dict[str, str]]:
    """The yardstick first, then every backend that can run here; the others with their reasons."""
    found, missing = [Contender(YARDSTICK, "cpu", Yardstick())], {}
    for name, reason in registry.available("cpu").items():
        device = "cpu"
        if reason is not None and torch.cuda.is_available():
            device, reason = "cuda", registry.available("cuda")[name]
        if reason is None:
            found.append(Contender(name, device, resolve(name, device)))  # pyright: ignore[reportArgumentType]
        else:
            missing[name] = reason
    return found, missing


def squares_yardstick() -> Contender:
    """Takes part in the timing of rasterizers only: its picture is another one."""
    return Contender(SQUARES, "cpu", SquaresYardstick())


PROJECTED = ("means2d", "conics", "depths", "opacities", "colors")


def tensors_of_projected(projected: ProjectedSplats) -> list[Tensor]:
    """The differentiable ones."""
    return [getattr(projected, name) for name in PROJECTED]


def as_leaves(projected: ProjectedSplats) -> ProjectedSplats:
    """The same numbers cut off from the graph behind them, requiring gradients."""
    leaves = {name: getattr(projected, name).detach().requires_grad_() for name in PROJECTED}
    return replace(projected, **leaves)


def images_of(rendering: Rendering) -> list[Tensor]:
    """rgb, alpha and, if rendered, depth."""
    images = [rendering.rgb, rendering.alpha]
    return images if rendering.depth is None else [*images, rendering.depth]


def cotangents(images: list[Tensor], seed: int = 0) -> list[Tensor]:
    """Fixed random gradients for images, in [0, 1)."""
    rng = torch.Generator().manual_seed(seed)
    return [torch.rand(image.shape, generator=rng).to(image) for image in images]
