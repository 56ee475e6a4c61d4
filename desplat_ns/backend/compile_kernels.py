"""Put all kernels of the numba backend into numba's cache: half a minute, once for each CPU.

python -m desplat_ns.backend.compile_kernels

The first launch of a process runs this by itself where it finds no kernels.
"""

from __future__ import annotations

import torch

from desplat_ns.backend.numba_kernels.runtime import compile_here
from desplat_ns.backend.numba_tiles import NumbaRasterizer
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.ssim import ssim

SIZE = 32
"""Pixels, enough for SSIM's window."""


def main() -> None:
    """Call every kernel: draw one Gaussian, score the image, and follow the gradients back."""
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
    image = NumbaRasterizer()(splats, View(torch.eye(4), K, SIZE, SIZE), RenderSettings()).rgb
    ssim(image, torch.zeros_like(image)).backward()


if __name__ == "__main__":
    main()
