"""What is particular to the torch backend.

What all backends share is in `test_contract.py` and `test_hostile_input.py`.
"""

from __future__ import annotations

import resource
import subprocess
import sys

import pytest

MEMORY = """
import resource, torch
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.torch_tiles import TorchRasterizer

torch.set_num_threads(1)
torch.manual_seed(0)
n, width, height = 25_000, 320, 210
z = 2 + 4 * torch.rand(n, 1)
means = torch.cat([torch.rand(n, 2) - 0.5, torch.ones(n, 1)], -1) * z * torch.tensor([1.2, 0.8, 1])
scales = torch.exp(0.5 * torch.randn(n, 3) - 5.0)
leaves = [means, torch.randn(n, 4), scales, torch.sigmoid(torch.randn(n)), torch.randn(n, 16, 3)]
leaves = [t.requires_grad_() for t in leaves]
K = torch.tensor([[266.0, 0, 160], [0, 266, 105], [0, 0, 1]])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
got = TorchRasterizer()(
    Splats(*leaves, sh_degree=3), View(torch.eye(4), K, width, height),
    RenderSettings(depth=True, absgrad=True),
)
(got.rgb.square().sum() + got.depth.sum()).backward()
assert got.alpha.mean() > 0.5
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(resource, "RUSAGE_SELF"), reason="needs POSIX resource usage")
def test_25_000_gaussians_at_320_x_210_stay_under_350_mib():
    """Tiles are computed again for the gradients: what all of them hold would be gigabytes."""
    done = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 350, f"{done.stdout} MiB"
