"""Compile all kernels that this machine can use, once, before they are needed.

python -m desplat_ns.backend.compile_kernels

numba's take half a minute of two cores for each CPU, gsplat's half an hour for each kind of GPU.
What is compiled already is left as it is. Without this, the first run that needs them has them
compiled. Where no GPU is seen, TORCH_CUDA_ARCH_LIST names the one that gsplat's are compiled for.
"""

import argparse
import os
import sys
from collections.abc import Sequence

import torch

from desplat_ns.backend import gsplat_build
from desplat_ns.backend.registry import compile_kernels

BACKENDS = ("numba", "gsplat")


def unavailable(name: str) -> str | None:
    """Have a backend's kernels compiled; why there are none, if there are none."""
    if name == "numba":
        compile_kernels("numba", "cpu")
        return None
    if torch.cuda.is_available() or os.environ.get("TORCH_CUDA_ARCH_LIST"):
        return gsplat_build.unavailable_reason()
    return "draws on CUDA devices, and torch sees none."


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 1 where a backend that was asked for, or that has its device, has no kernels."""
    parser = argparse.ArgumentParser(
        prog="python -m desplat_ns.backend.compile_kernels",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("backend", nargs="?", choices=BACKENDS, help="alone; else both")
    asked: str | None = parser.parse_args(arguments).backend
    reasons = {name: unavailable(name) for name in ([asked] if asked else BACKENDS)}
    for name, reason in reasons.items():
        print(f"{name}: {reason or 'kernels are there'}")
    return int(any(reasons.values()) and bool(asked or torch.cuda.is_available()))


if __name__ == "__main__":
    sys.exit(main())
