"""Which rasterizers there are, which of them can run here, and which one `auto` means."""

import importlib
import time
from typing import Literal, get_args

import torch

from desplat_ns.backend import gsplat_build
from desplat_ns.backend.protocol import Rasterizer
from desplat_ns.core.errors import BackendUnavailableError

BackendName = Literal["auto", "gsplat", "torch", "numba"]
BACKEND_NAMES: tuple[str, ...] = get_args(BackendName)
"""What `--pipeline.model.backend` accepts."""

_CLASSES = {
    "gsplat": ("desplat_ns.backend.gsplat_cuda", "GsplatRasterizer"),
    "numba": ("desplat_ns.backend.numba_tiles", "NumbaRasterizer"),
    "torch": ("desplat_ns.backend.torch_tiles", "TorchRasterizer"),
}
"""Where each backend lives. It is imported when it is asked for."""

FASTEST = {"cuda": "gsplat", "cpu": "numba"}
"""What `auto` is on a device type; `torch` on others."""


def unavailable_reason(name: str, device: str) -> str | None:
    """Why a backend cannot run on a device type ("cpu", "cuda") and what to do; None where it can.
    On CUDA `auto` is gsplat or none: the others would be slow there in silence."""
    if name == "numba" and device != "cpu":
        return (
            f"renders on the CPU and the model is on {device}. Add `--machine.device-type cpu`, or "
            "`--pipeline.model.backend gsplat`."
        )
    if name != "gsplat":
        return None
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
    reason = gsplat_build.unavailable_reason()
    if reason is None:
        return None
    return f"{reason} Or put `CUDA_VISIBLE_DEVICES=` before the command: it then runs on the CPU."


def default_device() -> str:
    """Device type that nerfstudio's commands take by themselves."""
    return "cuda" if torch.cuda.is_available() else "cpu"


def resolve(name: BackendName, device: str | None = None) -> Rasterizer:
    """The rasterizer called `name`; `auto` is the fastest that there is for the device type.

    Args:
        device: "cpu" or "cuda", where the splats will be; by default what this machine has.

    Raises:
        BackendUnavailableError: `name` is unknown, or cannot run there.
    """
    device = device or default_device()
    taken = FASTEST.get(device, "torch") if name == "auto" else name
    if taken not in _CLASSES:
        choices = ", ".join(BACKEND_NAMES)
        raise BackendUnavailableError(f"There is no backend '{name}'. Choose one of: {choices}.")
    reason = unavailable_reason(taken, device)
    if reason is not None:
        raise BackendUnavailableError(f"Backend '{taken}' {reason}")
    module, class_name = _CLASSES[taken]
    return getattr(importlib.import_module(module), class_name)()


def compile_kernels(name: BackendName, device: str) -> float:
    """Have compiled whatever a backend needs on a device type; seconds that this took, about none
    where it was there. Raises as `resolve`."""
    began = time.monotonic()
    if resolve(name, device).name == "numba":
        from desplat_ns.backend.numba_kernels import runtime

        runtime.prepare()
    return time.monotonic() - began
