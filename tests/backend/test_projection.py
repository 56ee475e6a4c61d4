from __future__ import annotations

import dataclasses

import pytest
import torch
from gsplat.cuda._torch_impl import _fully_fused_projection, _quat_scale_to_covar_preci
from torch import Tensor

from desplat_ns.backend import RenderSettings
from desplat_ns.backend.projection import ProjectedSplats, project, view_colors
from tests.backend.scenes import TestScene, one_gaussian, random_scene

EPS = torch.finfo(torch.float64).eps


def gsplats_projection(scene: TestScene, settings: RenderSettings) -> tuple[Tensor, ...]:
    """gsplat's own, for one camera: radii, means2d, depths, conics, compensations."""
    covars, _ = _quat_scale_to_covar_preci(scene.quats, scene.scales, True, False)
    assert covars is not None
    out = _fully_fused_projection(
        scene.means,
        covars,
        scene.viewmat[None],
        scene.K[None],
        *scene.size,
        calc_compensations=True,
    )
    return tuple(t[0] for t in out if t is not None)


def project_scene(scene: TestScene, settings: RenderSettings) -> ProjectedSplats:
    return project(scene.splats, scene.view, settings)


def test_projection_is_gsplats():
    settings = RenderSettings(antialiased=True)
    scene = random_scene(0, count=300, size=(64, 48)).to(torch.float64)
    got = project_scene(scene, settings)
    radii, means2d, depths, conics, compensations = gsplats_projection(scene, settings)
    visible = got.radii > 0
    # What gsplat sees is seen here; beyond, only what reaches in with more than 3 sigma.
    assert (visible | (radii == 0)).all()
    assert torch.equal(got.radii[radii > 0], radii[radii > 0])
    # About 100 rounded operations; determinants of these ellipses lose another factor of 30.
    for mine, theirs in (
        (got.means2d[0], means2d),
        (got.depths, depths),
        (got.conics, conics),
        (got.opacities, scene.opacities * compensations),
    ):
        assert ((mine - theirs).abs()[visible] <= 3000 * EPS * theirs.abs()[visible].max()).all()


def test_the_slope_in_the_jacobian_stops_beyond_the_border():
    # x / z = 10, the image ends at 4.5 / 16 and the margin at 0.3 of that beyond: 0.365625.
    far_out = one_gaussian(means=torch.tensor([[20.0, 0.0, 2.0]])).to(torch.float64)
    got = project_scene(far_out, RenderSettings())
    slope = 1.3 * 4.5 / 16
    assert got.means2d[0, 0, 0].item() == pytest.approx(16 * 10 + 4.5)
    assert 1 / got.conics[0, 0].item() == pytest.approx(1 + slope**2 + 0.3)
    assert got.radii.item() == 0


@pytest.mark.parametrize(("antialiased", "sh_degree"), [(True, None), (False, 3)])
def test_gradients_are_those_of_finite_differences(antialiased, sh_degree):
    scene = random_scene(2, count=3, sh_degree=sh_degree).to(torch.float64)
    settings = RenderSettings(antialiased=antialiased)

    def outputs(*values: Tensor) -> tuple[Tensor, ...]:
        *parameters, viewmat, K = values
        changed = TestScene(*parameters, viewmat=viewmat, K=K, size=scene.size, sh_degree=sh_degree)
        got = project_scene(changed, settings)
        return got.means2d, got.conics, got.depths, got.opacities, got.colors

    inputs = (*scene.parameters, scene.viewmat.requires_grad_(), scene.K.requires_grad_())
    assert torch.autograd.gradcheck(outputs, inputs, fast_mode=sh_degree is not None)


def test_lower_degrees_leave_higher_coefficients_alone():
    scene = random_scene(4, count=5, sh_degree=3).to(torch.float64)
    lower = dataclasses.replace(scene, sh_degree=1)
    cut = dataclasses.replace(lower, colors=scene.colors[:, :4])
    got, want = view_colors(lower.splats, lower.view), view_colors(cut.splats, cut.view)
    # Four products of at most 0.5 and their sum, in any order.
    most = 4 * 2 * 0.5 * scene.colors.abs().max().item() * torch.finfo(torch.float64).eps
    torch.testing.assert_close(got, want, rtol=0, atol=most)
