"""Compiles every kernel of the numba backend anew: half a minute of two cores."""

import os
import subprocess
import sys

import pytest

GRADIENTS = """
import hashlib, sys, torch
from desplat_ns.backend.numba_tiles import NumbaRasterizer
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.losses import photometric_losses

torch.manual_seed(0)
n, (width, height) = 500, (60, 40)
leaves = [torch.rand(n, 3) - torch.tensor([0.5, 0.5, -1.0]), torch.randn(n, 4)]
leaves += [0.02 + 0.05 * torch.rand(n, 3), torch.rand(n), torch.rand(n, 16, 3) - 0.5]
for leaf in leaves:
    leaf.requires_grad_()
view = View(torch.eye(4), torch.tensor([[50.0, 0, 30], [0, 50, 20], [0, 0, 1]]), width, height)
rgb = NumbaRasterizer()(Splats(*leaves, sh_degree=3), view, RenderSettings()).rgb
photo = torch.rand(height, width, 3)
photometric_losses(photo, None, 0.2, rgb)[0].backward()
results = [rgb.detach(), *(leaf.grad for leaf in leaves)]
print([hashlib.sha1(result.numpy().tobytes()).hexdigest() for result in results])
"""


@pytest.mark.slow
def test_the_process_that_finds_no_kernels_computes_what_later_ones_do(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    first, second = (
        subprocess.run(
            [sys.executable, "-c", GRADIENTS],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        for _ in range(2)
    )
    assert "Compiling" in first.stderr
    assert "Compiling" not in second.stderr
    assert first.stdout == second.stdout
