"""The calls that the gsplat backend makes of gsplat's kernels, recorded without a GPU.

gsplat's Python is the real one, from `rasterization` down; only its compiled module is a stand-in,
which notes what it is given and answers with zeros of the right shapes.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any
from unittest import mock

import torch
from torch import Tensor

from desplat_ns.backend import RenderSettings, gsplat_cuda
from desplat_ns.calibration.scenes import make_scene
from lab.gpu.declarations import Parameter

SIZE = (5, 48, 33)
"""Gaussians, width and height of what is drawn; tiles are 16 pixels wide."""

Values = dict[str, Any]


@dataclass(frozen=True)
class Call:
    """One call of a kernel."""

    kernel: str
    values: tuple[Any, ...]


def _projected(v: Values) -> tuple[Tensor, ...]:
    views, count = len(v["viewmats"]), len(v["means"])
    radii = (views, count, 2) if "opacities" in v else (views, count)  # 1.5: one for each axis
    floats = [torch.zeros(views, count, *last) for last in ((2,), (), (3,), ())]
    return (torch.ones(radii, dtype=torch.int32), *floats)


def _projected_back(v: Values) -> tuple[Tensor, ...]:
    names = ("means", "means", "quats", "scales", "viewmats")  # no covariances were given
    return tuple(torch.zeros_like(v[name]) for name in names)


def _in_tiles(v: Values) -> tuple[Tensor, ...]:
    tiles = torch.ones(v["depths"].shape, dtype=torch.int32)
    flat = torch.arange(v["depths"].numel(), dtype=torch.int32)
    return tiles, flat.to(torch.int64), flat


def _offsets(v: Values) -> Tensor:
    views = v["C"] if "C" in v else v["I"]  # of gsplat 1.4 and 1.5
    return torch.zeros(views, v["tile_height"], v["tile_width"], dtype=torch.int32)


def _drawn(v: Values) -> tuple[Tensor, ...]:
    size = (len(v["colors"]), v["image_height"], v["image_width"])
    colors = torch.zeros(*size, v["colors"].shape[-1])
    return colors, torch.zeros(*size, 1), torch.zeros(size, dtype=torch.int32)


def _drawn_back(v: Values) -> tuple[Tensor, ...]:
    names = ("means2d", "means2d", "conics", "colors", "opacities")
    return tuple(torch.zeros_like(v[name]) for name in names)


def _harmonics(v: Values) -> Tensor:
    return torch.zeros_like(v["dirs"])


def _harmonics_back(v: Values) -> tuple[Tensor, ...]:
    return torch.zeros_like(v["coeffs"]), torch.zeros_like(v["dirs"])


ANSWERS: dict[str, Callable[[Values], Any]] = {
    "fully_fused_projection_fwd": _projected,
    "fully_fused_projection_bwd": _projected_back,
    "isect_tiles": _in_tiles,
    "isect_offset_encode": _offsets,
    "rasterize_to_pixels_fwd": _drawn,
    "rasterize_to_pixels_bwd": _drawn_back,
    "compute_sh_fwd": _harmonics,
    "compute_sh_bwd": _harmonics_back,
    # gsplat 1.5
    "projection_ewa_3dgs_fused_fwd": _projected,
    "projection_ewa_3dgs_fused_bwd": _projected_back,
    "intersect_tile": _in_tiles,
    "intersect_offset": _offsets,
    "rasterize_to_pixels_3dgs_fwd": _drawn,
    "rasterize_to_pixels_3dgs_bwd": _drawn_back,
    "spherical_harmonics_fwd": _harmonics,
    "spherical_harmonics_bwd": _harmonics_back,
}
"""What the kernels that are called give back, by name."""


class Recorder:
    """In the place of gsplat's compiled module."""

    def __init__(self, declared: dict[str, tuple[Parameter, ...]]) -> None:
        self.calls: list[Call] = []
        self.CameraModelType = SimpleNamespace(PINHOLE="PINHOLE")
        self.PINHOLE = "PINHOLE"
        self._declared = declared

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in self._declared:
            raise AttributeError(f"gsplat declares no kernel '{name}'")

        def kernel(*values: Any) -> Any:
            self.calls.append(Call(name, values))
            names = [parameter.name for parameter in self._declared[name]]
            return ANSWERS[name](dict(zip(names, values, strict=False)))

        return kernel


@contextmanager
def _in_place_of_the_kernels(recorder: Recorder) -> Iterator[None]:
    """Within, gsplat's functions call the recorder, and the backend takes tensors on the CPU."""
    modules = {
        "gsplat.csrc": recorder,
        "gsplat.cuda._backend": SimpleNamespace(_C=recorder),
    }
    with (
        mock.patch.dict(sys.modules, modules),
        mock.patch.object(gsplat_cuda, "_check_cuda_float32", lambda means: None),
    ):
        yield


def all_settings() -> Sequence[RenderSettings]:
    """Every way in which kernels are called."""
    return [
        RenderSettings(antialiased=antialiased, depth=depth, absgrad=absgrad)
        for antialiased, depth, absgrad in itertools.product((False, True), repeat=3)
    ]


def record(declared: dict[str, tuple[Parameter, ...]]) -> list[Call]:
    """Calls of drawing a scene and following the gradients back, in all settings, with colours as
    spherical harmonics and as they are."""
    recorder = Recorder(declared)
    with _in_place_of_the_kernels(recorder):
        for settings in all_settings():
            for harmonics in (True, False):
                _draw(settings, harmonics)
    return recorder.calls


def _draw(settings: RenderSettings, harmonics: bool) -> None:
    scene = make_scene(*SIZE)
    splats = scene.splats()
    if not harmonics:
        splats = replace(splats, colors=splats.colors[:, 0], sh_degree=None)
    drawn = gsplat_cuda.GsplatRasterizer()(splats, scene.view_as(), settings)
    total = drawn.rgb.sum() + drawn.alpha.sum()
    (total if drawn.depth is None else total + drawn.depth.sum()).backward()
