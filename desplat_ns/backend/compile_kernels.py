"""Compile all kernels that this machine can use, once, before they are needed.

python -m desplat_ns.backend.compile_kernels

numba's take half a minute for each CPU, gsplat's some minutes for each kind of GPU. What is
compiled already is left as it is; what failed is tried again. Without this, the first run that
needs them compiles them: numba's by this command in a process of its own.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence

import torch

from desplat_ns.backend.gsplat_kernels import kernels
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.registry import available

SIZE = 32
"""Pixels, enough for SSIM's window."""


def compile_numba() -> str | None:
    """Call every kernel: draw one Gaussian over black, score that, follow the gradients back."""
    reason = available("cpu")["numba"]
    if reason is not None:
        return reason
    from desplat_ns.backend.numba_kernels.runtime import compile_here
    from desplat_ns.backend.numba_tiles import NumbaRasterizer
    from desplat_ns.backend.over import in_range, over
    from desplat_ns.backend.ssim import ssim

    compile_here()
    splats = Splats(
        means=torch.tensor([[0.0, 0.0, 1.0]], requires_grad=True),
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        scales=torch.full((1, 3), 0.1),
        opacities=torch.full((1,), 0.5),
        colors=torch.zeros(1, 4, 3),
        sh_degree=1,
    )
    K = torch.tensor([[SIZE, 0, SIZE / 2], [0, SIZE, SIZE / 2], [0, 0, 1]])
    drawn = NumbaRasterizer()(splats, View(torch.eye(4), K, SIZE, SIZE), RenderSettings())
    image = in_range(over(drawn.rgb, drawn.alpha, torch.zeros(3)))
    ssim(image, torch.zeros_like(image)).backward()
    return None


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
