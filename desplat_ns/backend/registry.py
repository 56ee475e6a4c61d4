"""Which rasterizers there are, which of them can run here, and which one `auto` means."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal, get_args

import torch

from desplat_ns.backend.protocol import Rasterizer
from desplat_ns.errors import BackendUnavailableError

BackendName = Literal["auto", "gsplat", "torch", "numba"]
BACKEND_NAMES: tuple[str, ...] = get_args(BackendName)
"""What `--pipeline.model.backend` accepts."""


@dataclass(frozen=True)
class _Entry:
    """Where a backend lives and what it needs. Nothing of it is imported before it is asked for."""

    module: str
    class_name: str
    hindrance: Callable[[], str | None]
    """Why it cannot run here and what to do, as one sentence or two; None where it can."""


def _gsplat_hindrance() -> str | None:
    if not torch.cuda.is_available():
        return (
            "needs a CUDA device and torch sees none. Add `--pipeline.model.backend numba`, "
            "or install a CUDA build of torch."
        )
    from desplat_ns.backend.gsplat_cuda import kernels_are_built

    if not kernels_are_built():
        return (
            "has no CUDA kernels here: install the CUDA toolkit (nvcc) so that gsplat can build "
            "them, or a gsplat wheel with kernels for this torch."
        )
    return None


def _numba_hindrance() -> str | None:
    try:
        importlib.import_module("desplat_ns.backend.numba_tiles")
    except ImportError as error:
        return f"could not be imported ({error}). `pip install numba` brings it."
    return None


_BACKENDS: dict[str, _Entry] = {
    "gsplat": _Entry("desplat_ns.backend.gsplat_cuda", "GsplatRasterizer", _gsplat_hindrance),
    "numba": _Entry("desplat_ns.backend.numba_tiles", "NumbaRasterizer", _numba_hindrance),
    "torch": _Entry("desplat_ns.backend.torch_tiles", "TorchRasterizer", lambda: None),
}
"""In the order in which `auto` tries them: fastest first."""


def available() -> dict[str, str | None]:
    """For each backend None where it can run here, else the reason and what to do about it."""
    return {name: entry.hindrance() for name, entry in _BACKENDS.items()}


def resolve(name: BackendName) -> Rasterizer:
    """The rasterizer called `name`; `auto` is the fastest that can run here.

    Raises:
        BackendUnavailableError: `name` is unknown, or cannot run here.
    """
    if name == "auto":
        return resolve(_fastest())
    if name not in _BACKENDS:
        choices = ", ".join(BACKEND_NAMES)
        raise BackendUnavailableError(f"There is no backend '{name}'. Choose one of: {choices}.")
    entry = _BACKENDS[name]
    reason = entry.hindrance()
    if reason is not None:
        raise BackendUnavailableError(f"Backend '{name}' {reason}")
    return getattr(importlib.import_module(entry.module), entry.class_name)()


@cache
def _fastest() -> BackendName:
    """The first backend that can run; says once which one that is, and why not a faster one."""
    from nerfstudio.utils.rich_utils import CONSOLE

    passed_over = []
    for name in ("gsplat", "numba", "torch"):
        reason = _BACKENDS[name].hindrance()
        if reason is None:
            CONSOLE.log(f"Rasterizer backend: {name}.", *passed_over)
            return name
        if name != "gsplat" or torch.cuda.is_available():
            passed_over.append(f"\nBackend '{name}' {reason}")
    raise AssertionError("the torch backend runs everywhere")
