"""What is compared: every backend that can run here, or any other rasterizer."""

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

from desplat_ns.backend import Rasterizer, Rendering, registry, resolve
from desplat_ns.backend.projection import ProjectedSplats
from desplat_ns.backend.protocol import RenderSettings, Splats, View

SEAMS = {"numba": "_project", "torch": "project"}
"""Backends whose parts can be timed one by one: see `Contender.seam`."""


@dataclass(frozen=True)
class Contender:
    """A rasterizer, and the device on which it draws."""

    name: str
    device: str
    rasterizer: Rasterizer
    seam: str | None = None
    """The name under which the rasterizer's module calls the projection, if it calls the binning
    `tile_lists`: these two parts can then be timed, or left out, without copying a rasterizer."""
    address: str = ""
    """`module:ATTRIBUTE` under which another process finds it, unless it is a backend."""

    @property
    def module(self) -> ModuleType:
        return importlib.import_module(type(self.rasterizer).__module__)

    @property
    def has_seams(self) -> bool:
        """Whether its parts can be timed one by one."""
        return self.seam is not None

    def project(self, splats: Splats, view: View, settings: RenderSettings) -> ProjectedSplats:
        """Its own projection."""
        assert self.seam is not None, f"{self.name} has no parts"
        return getattr(self.module, self.seam)(splats, view, settings)

    @contextmanager
    def with_parts(
        self, projected: ProjectedSplats | None, lists: Callable[..., Any]
    ) -> Iterator[None]:
        """Within, the rasterizer takes `projected`, if given, and gets its lists from `lists`."""
        with mock.patch.object(self.module, "tile_lists", lists):
            if projected is None:
                yield
                return
            assert self.seam is not None, f"{self.name} has no parts"
            with mock.patch.object(self.module, self.seam, lambda *_: projected):
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


def backends() -> tuple[list[Contender], dict[str, str]]:
    """Every backend that can run here; the others with their reasons."""
    runnable, missing = [], {}
    for name, reason in registry.available("cpu").items():
        device = "cpu"
        if reason is not None and torch.cuda.is_available():
            device, reason = "cuda", registry.available("cuda")[name]
        if reason is None:
            rasterizer = resolve(name, device)  # pyright: ignore[reportArgumentType]
            runnable.append(Contender(name, device, rasterizer, SEAMS.get(name)))
        else:
            missing[name] = reason
    return runnable, missing


def contender_called(name: str) -> Contender:
    """The contender that another process was told of on its command line.

    Args:
        name: of a backend that can run here, or a Contender's `address`.
    """
    module, _, attribute = name.partition(":")
    if attribute:
        return getattr(importlib.import_module(module), attribute)
    (contender,) = (c for c in backends()[0] if c.name == name)
    return contender


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
