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
    hindrance: Callable[[str], str | None]
    """Of a device type ("cpu", "cuda"): why it cannot run there and what to do, as one sentence or
    two; None where it can."""


def _gsplat_hindrance(device: str) -> str | None:
    if not torch.cuda.is_available():
        return (
            "needs a CUDA device and torch sees none. Add `--pipeline.model.backend numba`, "
            "or install a CUDA build of torch."
        )
    if device != "cuda":
        return (
            f"renders on CUDA and the model is on the {device}. Add `--machine.device-type cuda`, "
            "or `--pipeline.model.backend numba`."
        )
    from desplat_ns.backend.gsplat_cuda import kernels_are_built

    if not kernels_are_built():
        return (
            "has no CUDA kernels here: install the CUDA toolkit (nvcc) so that gsplat can build "
            "them, or a gsplat wheel with kernels for this torch."
        )
    return None


def _numba_hindrance(device: str) -> str | None:
    if device != "cpu":
        return (
            f"renders on the CPU and the model is on {device}. Add `--machine.device-type cpu`, or "
            "`--pipeline.model.backend gsplat`."
        )
    try:
        importlib.import_module("desplat_ns.backend.numba_tiles")
    except ImportError as error:
        return f"could not be imported ({error}). `pip install numba` brings it."
    return None


_BACKENDS: dict[str, _Entry] = {
    "gsplat": _Entry("desplat_ns.backend.gsplat_cuda", "GsplatRasterizer", _gsplat_hindrance),
    "numba": _Entry("desplat_ns.backend.numba_tiles", "NumbaRasterizer", _numba_hindrance),
    "torch": _Entry("desplat_ns.backend.torch_tiles", "TorchRasterizer", lambda device: None),
}
"""In the order in which `auto` tries them: fastest first."""


def default_device() -> str:
    """Device type that nerfstudio's commands take by themselves."""
    return "cuda" if torch.cuda.is_available() else "cpu"


def available(device: str | None = None) -> dict[str, str | None]:
    """For each backend None where it can run on a device type, else why and what to do."""
    device = device or default_device()
    return {name: entry.hindrance(device) for name, entry in _BACKENDS.items()}


def resolve(name: BackendName, device: str | None = None) -> Rasterizer:
    """The rasterizer called `name`; `auto` is the fastest that can run on the device type.

    Args:
        device: "cpu" or "cuda", where the splats will be; by default what this machine has.

    Raises:
        BackendUnavailableError: `name` is unknown, or cannot run there.
    """
    device = device or default_device()
    if name == "auto":
        return resolve(_fastest(device), device)
    if name not in _BACKENDS:
        choices = ", ".join(BACKEND_NAMES)
        raise BackendUnavailableError(f"There is no backend '{name}'. Choose one of: {choices}.")
    entry = _BACKENDS[name]
    reason = entry.hindrance(device)
    if reason is not None:
        raise BackendUnavailableError(f"Backend '{name}' {reason}")
    return getattr(importlib.import_module(entry.module), entry.class_name)()


@cache
def _fastest(device: str) -> BackendName:
    """The first backend that can run; says once which one that is, and why not a faster one."""
    from nerfstudio.utils.rich_utils import CONSOLE

    passed_over = []
    for name in ("gsplat", "numba", "torch"):
        reason = _BACKENDS[name].hindrance(device)
        if reason is None:
            CONSOLE.log(f"Rasterizer backend: {name}.", *passed_over)
            return name
        if (name == "gsplat" and device == "cuda") or (name == "numba" and device == "cpu"):
            passed_over.append(f"\nBackend '{name}' {reason}")
    raise AssertionError("the torch backend runs everywhere")
