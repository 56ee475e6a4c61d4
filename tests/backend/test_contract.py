"""What every backend must do, each against the float64 reference in `reference.py`.

Pixels where an alpha or a transmittance lies within rounding of a jump (cutoff, clamp, stop) may
go either way; they are left out of the comparison and of the loss, and there may be few of them.
"""

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from desplat_ns.backend import RenderSettings, resolve
from tests.backend.scenes import (
    PARAMETERS,
    Backend,
    TestScene,
    joined,
    one_gaussian,
    random_scene,
    render_reference,
    tolerance,
)

DEPTH = RenderSettings(depth=True)
MODES = [
    pytest.param(RenderSettings(depth=True, absgrad=True), id="classic"),
    pytest.param(RenderSettings(depth=True, absgrad=True, antialiased=True), id="antialiased"),
]

SHARPNESS = 1 / math.sqrt(1.3)
"""Of `one_gaussian`, whose variance is 1 + 0.3 pixels^2."""


def assert_agrees(backend: Backend, scene: TestScene, settings: RenderSettings = DEPTH) -> None:
    """Compare colour, alpha and depth, and the gradients of a random linear functional of them."""
    truth = scene.to(torch.float64)
    want = render_reference(truth, settings)
    want.means2d.retain_grad()
    allowed = tolerance(backend.dtype, scene.size, want.sharpness)
    safe = (want.margin > allowed)[..., None]
    assert safe.double().mean() >= 0.9
    leaves, got = backend.render(scene, settings)
    assert got.depth is not None
    # A depth is the quotient of two sums: an error relative to their weight.
    far = 0.5 * want.alpha.clamp(max=1) / want.depth.max().clamp(min=1e-10)
    difference = {
        "rgb": (got.rgb.cpu() - want.rgb) / max(1.0, want.rgb.max().item()),
        "alpha": got.alpha.cpu() - want.alpha,
        "depth": (got.depth.cpu() - want.depth) * far,
    }
    for name, error in difference.items():
        assert (error.abs() * safe).max() <= allowed, name
    rng = torch.Generator().manual_seed(7)
    for name in ("rgb", "alpha", "depth"):
        image = getattr(want, name)
        factor = torch.rand(image.shape, generator=rng, dtype=torch.float64) - 0.3
        # An expected depth has no slope bound where next to nothing is drawn.
        factor = factor * safe * (want.alpha.detach() > 0.02)
        (image * factor).sum().backward(retain_graph=True)
        part = getattr(got, name)
        (part * factor.to(part)).sum().backward(retain_graph=name != "depth")
    for name in PARAMETERS:
        assert_close(name, getattr(leaves, name).grad, getattr(truth, name).grad, allowed)
    assert got.means2d.grad is not None
    assert_close("means2d", got.means2d.grad[0], want.means2d.grad, allowed)


def assert_close(name: str, got: Tensor | None, want: Tensor | None, allowed: float) -> None:
    assert got is not None and want is not None, name
    # A term is a product of fewer than 10 factors, each off by the forward error at most.
    assert (got.cpu().double() - want).abs().max() <= 10 * allowed * want.abs().max(), name


@pytest.mark.parametrize("settings", MODES)
@pytest.mark.parametrize("sh_degree", [None, 0, 2, 4])
def test_values_and_gradients_agree_with_the_reference(backend, settings, sh_degree):
    assert_agrees(backend, random_scene(3, sh_degree=sh_degree), settings)


def test_lower_degrees_leave_higher_coefficients_alone(backend):
    assert_agrees(backend, dataclasses.replace(random_scene(4, sh_degree=3), sh_degree=1))


def test_a_stack_of_opaque_gaussians_agrees_where_blending_stops(exact_backend):
    scene = random_scene(11, count=150, opacity=(0.6, 0.99))
    stopped = render_reference(scene.to(torch.float64), RenderSettings()).alpha
    assert (stopped > 1 - 1e-3).double().mean() > 0.5
    assert_agrees(exact_backend, scene)


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (17, 5), (3, 33)])
def test_images_of_any_size_are_drawn(backend, size):
    assert_agrees(backend, random_scene(17, count=15, size=size))


def test_tiles_without_gaussians_show_nothing(backend):
    """Where nothing is drawn memory is not read before it is written: new tensors are NaN."""
    try:
        torch.use_deterministic_algorithms(True, warn_only=True)
        assert_agrees(backend, one_gaussian(size=(40, 36)))
    finally:
        torch.use_deterministic_algorithms(False)


def test_absgrad_is_the_sum_over_pixels_of_absolute_gradients(backend):
    scene = random_scene(19, count=12, size=(20, 18))
    truth = scene.to(torch.float64)
    want = render_reference(truth, RenderSettings())
    want.means2d_per_pixel.retain_grad()
    safe = want.margin > tolerance(backend.dtype, scene.size, want.sharpness)
    weights = torch.rand(18, 20, 3, generator=torch.Generator().manual_seed(1)).double() - 0.3
    weights = weights * safe[..., None]
    (want.rgb * weights).sum().backward()
    _, got = backend.render(scene, RenderSettings(absgrad=True))
    (got.rgb * weights.to(got.rgb)).sum().backward()
    assert want.means2d_per_pixel.grad is not None
    absgrad = want.means2d_per_pixel.grad.abs().sum(dim=0)[None]
    allowed = tolerance(backend.dtype, scene.size, want.sharpness)
    assert_close("absgrad", getattr(got.means2d, "absgrad", None), absgrad, allowed)


def test_radii_are_three_sigma_of_the_longer_axis(backend):
    scene = random_scene(23)
    sigma = render_reference(scene.to(torch.float64), RenderSettings()).sigma_max
    _, got = backend.render(scene, RenderSettings())
    radii = got.radii.cpu()
    assert radii.dtype == torch.int32 and radii.shape == sigma.shape
    visible = radii > 0
    assert visible.double().mean() > 0.7
    # gsplat's formula keeps the longer axis a little longer where the two are alike.
    assert ((3 * sigma).ceil() <= radii)[visible].all()
    assert (radii <= (3 * (sigma.square() + 0.1).sqrt() + 1e-4).ceil())[visible].all()


def test_one_gaussian_gives_the_values_worked_out_by_hand(backend):
    # 0.125 / 2 * 16 = 1 pixel: variance 1 + 0.3; one pixel off the centre exp(-0.5 / 1.3).
    _, got = backend.render(one_gaussian(), RenderSettings(depth=True))
    eps = tolerance(backend.dtype, (9, 9), SHARPNESS)
    assert got.alpha[4, 4].item() == pytest.approx(0.5, rel=eps)
    assert got.alpha[4, 5].item() == pytest.approx(0.5 * math.exp(-0.5 / 1.3), rel=eps)
    assert got.rgb[4, 4].tolist() == pytest.approx([0.5, 0.25, 0.125], rel=eps)
    assert got.depth is not None
    assert got.depth[4, 4].item() == pytest.approx(2.0, rel=eps)
    # 4 pixels off: 0.5 exp(-8 / 1.3) = 0.00106 is below 1/255: nothing is drawn, depth is 0.
    assert got.alpha[4, 0].item() == got.depth[4, 0].item() == 0.0
    # ceil(3 sqrt(1.3 + sqrt(0.01))) = ceil(3.55)
    assert got.radii.tolist() == [4]


@pytest.mark.parametrize("sh", [0.0, -0.5, -0.7])
def test_a_colour_cut_at_0_can_become_lighter_and_not_darker(backend, sh):
    """SH + 1/2 is 1/2, 0 and -0.2: a black one, and one below, had no gradient in any view."""
    black = torch.full((1, 1, 3), 2 * math.sqrt(math.pi) * sh)
    leaves, got = backend.render(one_gaussian(colors=black, sh_degree=0), RenderSettings())
    pixel = got.rgb[4, 4]
    assert pixel.tolist() == pytest.approx([0.25 if sh == 0 else 0.0] * 3, abs=1e-7)
    (up,) = torch.autograd.grad(-pixel.sum(), leaves.colors, retain_graph=True)
    (down,) = torch.autograd.grad(pixel.sum(), leaves.colors)
    slope = 0.5 * 0.5 / math.sqrt(math.pi)  # opacity times the constant harmonic
    assert up.flatten().tolist() == pytest.approx([-slope] * 3, rel=1e-6)
    assert down.flatten().tolist() == pytest.approx([slope if sh == 0 else 0.0] * 3, rel=1e-6)


@pytest.mark.parametrize("direction", [(1, 0), (0, -1)])
def test_what_lies_beyond_the_border_shows_as_far_as_its_alpha_reaches(exact_backend, direction):
    # 10.7 pixels wide off the axis, 34 beyond the border: outside 3 sigma, alpha about 0.005.
    mean = [[38.5 / 8 * direction[0], 38.5 / 8 * direction[1], 2.0]]
    scene = one_gaussian(
        means=torch.tensor(mean), scales=torch.full((1, 3), 1.25), opacities=torch.tensor([1.0])
    )
    assert render_reference(scene.to(torch.float64), RenderSettings()).alpha.max() > 0.005
    assert_agrees(exact_backend, scene)


@pytest.mark.parametrize("sh_degree", [None, 3])
def test_the_camera_receives_gradients(backend, sh_degree):
    scene = random_scene(37, count=15, size=(16, 12), sh_degree=sh_degree)
    truth, leaves = scene.to(torch.float64), scene.to(backend.dtype, backend.device)
    want = render_reference(truth, RenderSettings())
    allowed = tolerance(backend.dtype, scene.size, want.sharpness)
    safe = (want.margin > allowed)[..., None]
    truth.viewmat.requires_grad_()
    leaves.viewmat.requires_grad_()
    want = render_reference(truth, RenderSettings())
    (want.rgb * safe).sum().backward()
    got = resolve(backend.name, backend.device)(leaves.splats, leaves.view, RenderSettings())  # pyright: ignore[reportArgumentType]
    (got.rgb * safe.to(got.rgb)).sum().backward()
    # All Gaussians' shares add up, so their rounding does too.
    assert truth.viewmat.grad is not None
    assert leaves.viewmat.grad is not None
    assert_close("viewmat", leaves.viewmat.grad[:3], truth.viewmat.grad[:3], 15 * allowed)


POISON = {
    "a NaN in the mean": {"means": [[math.nan, 0.0, 2.0]]},
    "a mean beyond float32's square root": {"means": [[1e30, 0.0, 2.0]]},
    "a mean in the camera's centre": {"means": [[0.0, 0.0, 0.0]]},
    "a zero quaternion": {"quats": [[0.0, 0.0, 0.0, 0.0]]},
    "an infinite scale": {"scales": [[math.inf, 0.1, 0.1]]},
    "a scale whose fourth power overflows": {"scales": [[math.exp(40), 0.1, 0.1]]},
    "a NaN opacity": {"opacities": [math.nan]},
    "a NaN colour": {"colors": [[math.nan, 0.0, 0.0]]},
}


@pytest.mark.parametrize("poison", POISON)
def test_a_broken_gaussian_is_not_drawn_and_spoils_nothing(backend, poison):
    settings = RenderSettings(depth=True, absgrad=True, antialiased=True)
    changes = {name: torch.tensor(value) for name, value in POISON[poison].items()}
    healthy = random_scene(29, count=10)
    healthy = dataclasses.replace(healthy, viewmat=torch.eye(4))
    healthy.means = healthy.means + torch.tensor([0.0, 0.0, 2.0])
    behind = one_gaussian(means=torch.tensor([[0.0, 0.0, -2.0]]))
    _, want = backend.render(joined(healthy, behind), settings)
    leaves, got = backend.render(joined(healthy, one_gaussian(**changes)), settings)
    assert got.radii[-1].item() == 0
    assert torch.equal(got.rgb, want.rgb) and torch.equal(got.alpha, want.alpha)
    assert got.depth is not None and want.depth is not None and torch.equal(got.depth, want.depth)
    (got.rgb.sum() + got.alpha.sum() + got.depth.sum()).backward()
    for name in PARAMETERS:
        gradient = getattr(leaves, name).grad
        assert gradient.isfinite().all(), name
        assert gradient[-1].abs().max() == 0, name
