"""gsplat's kernels in this process: loaded, for the GPUs that it sees."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import ModuleType

import torch

from desplat_ns.backend.gsplat_kernels.build import NAME, Target, forget_failure, library_for
from desplat_ns.backend.gsplat_kernels.tools import NoKernels


@cache
def unavailable_reason() -> str | None:
    """Why gsplat has no kernels for this machine's GPU, and what to do; None once they are loaded.

    The first call on a machine compiles them, for minutes, and says so.
    """
    try:
        if not _brought_by_gsplat():
            use(load(library_for(Target.here(architectures()))))
    except NoKernels as reason:
        return str(reason)
    return None


def try_again() -> None:
    """Let `unavailable_reason` compile once more what failed before."""
    with suppress(NoKernels):
        forget_failure(Target.here(architectures()))
    unavailable_reason.cache_clear()


def architectures() -> str:
    """Of this process's GPUs, or what TORCH_CUDA_ARCH_LIST says. Of later GPUs than torch knows it
    is the last that torch knows, from which the driver compiles the rest.

    Raises:
        NoKernels: torch has none for an old GPU either.
    """
    asked = os.environ.get("TORCH_CUDA_ARCH_LIST")
    if asked:
        return asked
    known = sorted(
        _capability(name) for name in torch.cuda.get_arch_list() if name.startswith("sm_")
    )
    found: set[str] = set()
    for device in range(torch.cuda.device_count()):
        capability = torch.cuda.get_device_capability(device)
        if known and capability < known[0]:
            raise NoKernels(
                f"cannot draw on {torch.cuda.get_device_name(device)}: it has compute capability "
                f"{_text(capability)}, and torch {torch.__version__} works from "
                f"{_text(known[0])} on. Install a torch for an earlier CUDA."
            )
        newer = bool(known) and capability > known[-1]
        found.add(f"{_text(known[-1])}+PTX" if newer else _text(capability))
    return ";".join(sorted(found))


def _capability(name: str) -> tuple[int, int]:
    """(9, 0) of "sm_90", (12, 0) of "sm_120"."""
    digits = "".join(letter for letter in name.partition("_")[2] if letter.isdigit())
    return int(digits[:-1]), int(digits[-1])


def _text(capability: tuple[int, int]) -> str:
    return f"{capability[0]}.{capability[1]}"


def load(library: Path) -> ModuleType:
    """The compiled module of a file.

    Raises:
        NoKernels: it does not fit what is installed.
    """
    spec = importlib.util.spec_from_file_location(NAME, library)
    assert spec is not None and spec.loader is not None
    try:
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except (ImportError, OSError) as error:
        raise NoKernels(
            f"cannot load its compiled CUDA kernels ({error}). Remove {library.parent}, and they "
            "are compiled again."
        ) from error
    return module


def use(module: ModuleType) -> None:
    """Let gsplat's functions call a compiled module: where its own wheels bring one, gsplat.csrc,
    it compiles nothing (gsplat 1.4 and 1.5, cuda/_backend.py)."""
    import gsplat

    sys.modules["gsplat.csrc"] = module
    gsplat.csrc = module  # pyright: ignore[reportAttributeAccessIssue]
    before = sys.modules.get("gsplat.cuda._backend")
    if before is not None:
        before._C = module  # pyright: ignore[reportAttributeAccessIssue]


def _brought_by_gsplat() -> bool:
    """Whether this gsplat was installed with its kernels."""
    try:
        importlib.import_module("gsplat.csrc")
    except (ImportError, OSError):
        return False
    return True
