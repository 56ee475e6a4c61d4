"""Which rasterizers there are, which of them can run here, and which one `auto` means."""

from __future__ import annotations

import importlib
import time
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

ON_THE_CPU = "Or put `CUDA_VISIBLE_DEVICES=` before the command: it then runs on the CPU."
"""What helps any command where a GPU cannot be used; most have no option for the device."""


@dataclass(frozen=True)
class _Entry:
    """Where a backend lives and what it needs. Nothing of it is imported before it is asked for."""

    module: str
    class_name: str
    unavailable_reason: Callable[[str], str | None]
    """Of a device type ("cpu", "cuda"): why it cannot run there and what to do, as one sentence or
    two; None where it can."""


def _gsplat_unavailable(device: str) -> str | None:
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
    from desplat_ns.backend.gsplat_kernels.kernels import unavailable_reason

    reason = unavailable_reason()
    return None if reason is None else f"{reason}\n{ON_THE_CPU}"


def _numba_unavailable(device: str) -> str | None:
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
    "gsplat": _Entry("desplat_ns.backend.gsplat_cuda", "GsplatRasterizer", _gsplat_unavailable),
    "numba": _Entry("desplat_ns.backend.numba_tiles", "NumbaRasterizer", _numba_unavailable),
    "torch": _Entry("desplat_ns.backend.torch_tiles", "TorchRasterizer", lambda device: None),
}

FASTEST_FIRST: dict[str, tuple[BackendName, ...]] = {"cuda": ("gsplat",), "cpu": ("numba", "torch")}
"""Which ones `auto` tries on a device type."""


def default_device() -> str:
    """Device type that nerfstudio's commands take by themselves."""
    return "cuda" if torch.cuda.is_available() else "cpu"


def available(device: str | None = None) -> dict[str, str | None]:
    """For each backend None where it can run on a device type, else why and what to do."""
    device = device or default_device()
    return {name: entry.unavailable_reason(device) for name, entry in _BACKENDS.items()}


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
    reason = entry.unavailable_reason(device)
    if reason is not None:
        raise BackendUnavailableError(f"Backend '{name}' {reason}")
    return getattr(importlib.import_module(entry.module), entry.class_name)()


@cache
def _fastest(device: str) -> BackendName:
    """The first backend that can run; says once which one that is, and why not a faster one.

    On CUDA that is gsplat or none. Without its kernels the torch backend would be slow in silence,
    and numba with the model on the CPU would leave the GPU idle for hours, in every run, where one
    command and half an hour of compiling, once, are all that is missing.

    Raises:
        BackendUnavailableError: on CUDA, if gsplat cannot run; says what to type for either.
    """
    from nerfstudio.utils.rich_utils import CONSOLE

    passed_over = []
    for name in FASTEST_FIRST.get(device, ("torch",)):
        reason = _BACKENDS[name].unavailable_reason(device)
        if reason is None:
            CONSOLE.log(f"Rasterizer backend: {name}.", *passed_over)
            return name
        passed_over.append(f"\nBackend '{name}' {reason}")
    raise BackendUnavailableError("".join(passed_over).strip())


def compile_kernels(name: BackendName, device: str) -> float:
    """Have compiled whatever a backend needs on a device type, or raise as `resolve` does.

    Returns:
        Seconds that this took; about none where they were there.
    """
    began = time.monotonic()
    if resolve(name, device).name == "numba":
        from desplat_ns.backend.numba_kernels.runtime import launching

        with launching():
            pass
    return time.monotonic() - began


def rendering_device(name: BackendName, device: str) -> tuple[str, str]:
    """The device type on which a trained model is rendered, and why if it is another one.

    Where no kernels draw on CUDA, that is the CPU: an image is a matter of a second there, and the
    run may have been trained there for the same reason.
    """
    if device != "cuda" or name == "torch":
        return device, ""
    if name == "numba":
        return "cpu", "its backend is numba"
    reason = _BACKENDS["gsplat"].unavailable_reason(device)
    if reason is None:
        return device, ""
    return "cpu", f"backend 'gsplat' {reason.removesuffix(ON_THE_CPU).strip()}"
