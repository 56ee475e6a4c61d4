from __future__ import annotations

import pytest
import torch

from desplat_ns.backend import RenderSettings
from desplat_ns.backend.numba_kernels.ewa import BATCH
from desplat_ns.backend.numba_kernels.projection import Project, make_camera
from desplat_ns.backend.projection import project
from tests.backend.scenes import one_gaussian, random_scene

EPS = torch.finfo(torch.float32).eps
NAMES = ("means", "quats", "scales", "opacities")


def compiled(scene, settings):
    parameters = [getattr(scene, name) for name in NAMES]
    return Project.apply(*parameters, make_camera(scene.view, settings.antialiased))


def plain(scene, settings):
    p = project(scene.splats, scene.view, settings)
    return p.means2d, p.conics, p.depths, p.opacities, p.radii


def assert_close(got, want, allowed):
    assert (got.double() - want.double()).abs().max() <= allowed * want.abs().max()


def pulled(outputs, visible):
    """Backward from a random linear functional of what is seen."""
    rng = torch.Generator().manual_seed(3)
    total = torch.zeros((), dtype=torch.float64)
    for tensor in outputs[:4]:
        rows = tensor.reshape(visible.numel(), -1)[visible]
        total = total + (rows * torch.randn(rows.shape, generator=rng)).double().sum()
    total.backward()


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("count", [1, BATCH, 3 * BATCH + 5])
def test_it_is_the_projection_of_the_other_backends(count, antialiased):
    settings = RenderSettings(antialiased=antialiased)
    scene = random_scene(41, count=count)
    leaves, truth = scene.to(torch.float32), scene.to(torch.float64)
    got, want = compiled(leaves, settings), plain(truth, settings)
    assert torch.equal(got[4], want[4])
    visible = want[4] > 0
    for a, b in zip(got[:4], want[:4], strict=True):
        # About 30 roundings; a conic adds the cancellation in the slopes of J W.
        assert_close(a.reshape(count, -1)[visible], b.reshape(count, -1)[visible], 100 * EPS)
    pulled(got, visible)
    pulled(want, visible)
    for name in NAMES:
        assert_close(getattr(leaves, name).grad, getattr(truth, name).grad, 300 * EPS)


def test_slopes_beyond_the_border_are_clamped_with_their_gradient():
    # At x/z = 1 the border, 0.28, is far: J's slope stays at 0.28 + 0.3 * 0.28.
    scene = one_gaussian(
        means=torch.tensor([[2.0, 0.3, 2.0]]), scales=torch.tensor([[0.9, 0.7, 1.1]])
    )
    leaves, truth = scene.to(torch.float32), scene.to(torch.float64)
    got, want = compiled(leaves, RenderSettings()), plain(truth, RenderSettings())
    assert want[4].item() > 0
    assert_close(got[1], want[1], 100 * EPS)
    pulled(got, want[4] > 0)
    pulled(want, want[4] > 0)
    for name in NAMES:
        assert_close(getattr(leaves, name).grad, getattr(truth, name).grad, 300 * EPS)


def test_culled_ones_get_zeros_whatever_comes_back():
    means = torch.tensor([[0.0, 0.0, 2.0], [0.0, 0.0, -2.0], [9e9, 0.0, 2.0], [0.0, 0.0, 0.0]])
    scene = one_gaussian(
        means=means,
        quats=torch.tensor([[1.0, 0, 0, 0]]).repeat(4, 1),
        scales=torch.full((4, 3), 0.1),
        opacities=torch.full((4,), 0.5),
        colors=torch.ones(4, 3),
    ).to(torch.float32)
    got = compiled(scene, RenderSettings())
    assert (got[4] > 0).tolist() == [True, False, False, False]
    assert all((t.reshape(4, -1)[1:] == 0).all() for t in got[:4])
    torch.autograd.backward(got[:4], [torch.full_like(t, torch.inf) for t in got[:4]])
    for name in NAMES:
        assert (getattr(scene, name).grad[1:] == 0).all()
