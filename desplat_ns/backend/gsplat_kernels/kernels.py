"""gsplat's kernels in this process: loaded, for the GPUs that it sees."""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import sys
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
    forget_failure(Target.here(architectures()))
    unavailable_reason.cache_clear()


def architectures() -> str:
    """Of this process's GPUs, or what TORCH_CUDA_ARCH_LIST says. Of later GPUs than torch knows it
    is the last that torch knows, from which the driver compiles the rest."""
    asked = os.environ.get("TORCH_CUDA_ARCH_LIST")
    if asked:
        return asked
    known = (name for name in torch.cuda.get_arch_list() if name.startswith("sm_"))
    newest = max((int(re.sub(r"\D", "", name)) for name in known), default=sys.maxsize)
    versions: set[str] = set()
    for device in range(torch.cuda.device_count()):
        major, minor = torch.cuda.get_device_capability(device)
        is_known = 10 * major + minor <= newest
        versions.add(f"{major}.{minor}" if is_known else f"{newest // 10}.{newest % 10}+PTX")
    return ";".join(sorted(versions))


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


def _brought_by_gsplat() -> bool:
    """Whether this gsplat was installed with its kernels."""
    try:
        importlib.import_module("gsplat.csrc")
    except (ImportError, OSError):
        return False
    return True
