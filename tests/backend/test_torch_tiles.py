"""Memory of the torch backend; what all backends share is in `test_contract.py`."""

import resource
import subprocess
import sys

import pytest

MEMORY = """
import resource, torch
from desplat_ns.backend import RenderSettings, resolve
from tests.backend.scenes import random_scene

torch.set_num_threads(1)
scene = random_scene(0, 10_000, size=(240, 160), sh_degree=3).to(torch.float32)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
got = resolve("torch", "cpu")(scene.splats, scene.view, RenderSettings(depth=True, absgrad=True))
(got.rgb.square().sum() + got.depth.sum()).backward()
assert got.alpha.mean() > 0.5
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(resource, "RUSAGE_SELF"), reason="needs POSIX resource usage")
def test_10_000_gaussians_at_240_x_160_stay_under_300_mib():
    """Tiles are computed again for the gradients: what all of them hold are 470 MiB."""
    done = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 300, f"{done.stdout} MiB"
