"""Compile all kernels that this machine can use, once, before they are needed.

python -m desplat_ns.backend.compile_kernels

numba's take a minute of one core for each CPU, gsplat's half an hour for each kind of GPU.
What is compiled already is left as it is; what failed is tried again. Without this, the first run
that needs them has them compiled.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence

import torch

from desplat_ns.backend.gsplat_kernels import kernels
from desplat_ns.backend.registry import available, compile_kernels


def compile_numba() -> str | None:
    """Have the kernels compiled; why they cannot run here, if they cannot."""
    reason = available("cpu")["numba"]
    if reason is None:
        compile_kernels("numba", "cpu")
    return reason


def compile_gsplat() -> str | None:
    """Compile and load gsplat's; why there are none, if there are none."""
    if not torch.cuda.is_available() and not os.environ.get("TORCH_CUDA_ARCH_LIST"):
        return "draws on CUDA devices, and torch sees none. TORCH_CUDA_ARCH_LIST names another's."
    kernels.try_again()
    return kernels.unavailable_reason()


COMPILERS = {"numba": compile_numba, "gsplat": compile_gsplat}


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 1 where a backend that was asked for, or that has its device, has no kernels."""
    parser = argparse.ArgumentParser(
        prog="python -m desplat_ns.backend.compile_kernels",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("backend", nargs="?", choices=COMPILERS, help="alone; else both")
    asked: str | None = parser.parse_args(arguments).backend
    failed = False
    for name in [asked] if asked else COMPILERS:
        began = time.monotonic()
        reason = COMPILERS[name]()
        spent = f"{time.monotonic() - began:.0f} s"
        print(f"{name}: " + (f"kernels are there ({spent})" if reason is None else reason))
        optional = name == "gsplat" and not torch.cuda.is_available() and not asked
        failed |= reason is not None and not optional
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
