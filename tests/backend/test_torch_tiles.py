"""What is particular to the torch backend.

What all backends share is in `test_contract.py` and `test_hostile_input.py`.
"""

from __future__ import annotations

import resource
import subprocess
import sys

import pytest
import torch
from torch import Tensor

from desplat_ns.backend import Rendering, RenderSettings, blending, resolve, torch_tiles
from tests.backend.scenes import PARAMETERS, TestScene, one_gaussian, random_scene


def draw(scene: TestScene, settings: RenderSettings) -> Rendering:
    return resolve("torch")(scene.splats, scene.view, settings)


@pytest.mark.parametrize(("batch", "elements"), [(1, 1), (3, 2000), (500, 1 << 22)])
def test_batches_change_nothing_but_rounding(monkeypatch, batch, elements):
    def results() -> list[Tensor]:
        scene = random_scene(2, count=80, size=(40, 33), opacity=(0.3, 1.0)).to(torch.float64)
        got = draw(scene, RenderSettings(depth=True, absgrad=True))
        assert got.depth is not None
        (got.rgb.square().sum() + got.depth.sum()).backward()
        gradients = [getattr(scene, name).grad for name in PARAMETERS]
        return [got.rgb, got.alpha, got.depth, *gradients, getattr(got.means2d, "absgrad", None)]  # pyright: ignore[reportReturnType]

    want = results()
    monkeypatch.setattr(torch_tiles, "BATCH", batch)
    monkeypatch.setattr(torch_tiles, "ELEMENTS", elements)
    for a, b in zip(results(), want, strict=True):
        assert (a - b).abs().max() <= 1e4 * torch.finfo(torch.float64).eps * b.abs().max()


def test_opaque_tiles_drop_out():
    # 400 layers of opacity 0.9 over the whole image: four of them make it opaque.
    rng = torch.Generator().manual_seed(0)
    layers = one_gaussian(
        means=torch.cat([torch.zeros(400, 2), 2 + torch.rand(400, 1, generator=rng)], dim=-1),
        quats=torch.ones(400, 4),
        scales=torch.full((400, 3), 50.0),
        opacities=torch.full((400,), 0.9),
        colors=torch.rand(400, 3, generator=rng),
    ).to(torch.float32)
    blended = []
    original = blending.Scene.blend
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blending.Scene, "blend", lambda *a: blended.append(1) or original(*a))
        draw(layers, RenderSettings())
    assert len(blended) == 1


def test_second_derivatives_are_refused_rather_than_wrong():
    scene = random_scene(3, count=5).to(torch.float64)
    (gradient,) = torch.autograd.grad(
        draw(scene, RenderSettings()).rgb.square().sum(), scene.means, create_graph=True
    )
    with pytest.raises(RuntimeError, match=r"once_differentiable|twice"):
        gradient.sum().backward()


MEMORY = """
import resource, torch
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.torch_tiles import TorchRasterizer

torch.set_num_threads(1)
torch.manual_seed(0)
n, width, height = 100_000, 640, 420
z = 2 + 4 * torch.rand(n, 1)
means = torch.cat([torch.rand(n, 2) - 0.5, torch.ones(n, 1)], -1) * z * torch.tensor([1.2, 0.8, 1])
scales = torch.exp(0.5 * torch.randn(n, 3) - 5.0)
leaves = [means, torch.randn(n, 4), scales, torch.sigmoid(torch.randn(n)), torch.randn(n, 16, 3)]
leaves = [t.requires_grad_() for t in leaves]
K = torch.tensor([[533.0, 0, 320], [0, 533, 210], [0, 0, 1]])
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
def test_100_000_gaussians_at_640_x_420_stay_under_1_gib():
    done = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 1024, f"{done.stdout} MiB"
