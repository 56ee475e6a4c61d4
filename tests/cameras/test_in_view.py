"""What `in_view` leaves out is not drawn: the same picture and gradients, to the last bit.

`numba` gives a Gaussian the same bits in any row, and draws the others alone. How torch rounds a
row depends on its place and on the processor: there those left out keep theirs, transparent.
"""

from dataclasses import replace
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from desplat_ns.backend import BackendName
from desplat_ns.backend.constants import NEAR_PLANE
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.registry import resolve
from desplat_ns.cameras.in_view import in_view

WIDTH, HEIGHT = 40, 28
PARAMETERS = ("means", "quats", "scales", "opacities", "colors")


def view_at(turn: list[float], place: list[float], focal: float) -> View:
    """A turned camera, off the middle of its image, of unequal focal lengths."""
    axis = torch.tensor([turn], dtype=torch.float64)
    rotation = torch.linalg.matrix_exp(torch.linalg.cross(torch.eye(3).double(), -axis))
    viewmat = torch.eye(4, dtype=torch.float64)
    viewmat[:3, :3] = rotation
    viewmat[:3, 3] = -rotation @ torch.tensor(place, dtype=torch.float64)
    K = torch.tensor([[focal, 0, 0.4 * WIDTH], [0, 1.2 * focal, 0.6 * HEIGHT], [0, 0, 1]])
    return View(viewmat.float(), K, WIDTH, HEIGHT)


def cloud(seed: int, count: int = 120) -> Splats:
    """Gaussians around the origin, from a thousandth of a unit to tens of units long, some of them
    needles, some fainter than the cutoff; many at the place of a camera that stands there."""
    rng = torch.Generator().manual_seed(seed)
    spread = 10 ** (2.5 * torch.rand(count, 1, generator=rng) - 1.5)
    log_scales = 4.5 * torch.rand(count, 3, generator=rng) - 3
    small = torch.rand(count, generator=rng) < 0.6
    log_scales[small] -= 1.5
    return Splats(
        means=spread * torch.randn(count, 3, generator=rng),
        quats=torch.randn(count, 4, generator=rng),
        scales=10**log_scales,
        opacities=10 ** (-3 * torch.rand(count, generator=rng)),
        colors=torch.rand(count, 3, generator=rng),
    )


def drawn(name: BackendName, splats: Splats, view: View, settings: RenderSettings) -> Any:
    """Rendering and gradients by all parameters, for fixed gradients of the images."""
    leaves = {n: getattr(splats, n).clone().requires_grad_() for n in PARAMETERS}
    rendering = resolve(name, "cpu")(Splats(**leaves), view, settings)  # type: ignore[arg-type]
    rng = torch.Generator().manual_seed(1)
    images = [rendering.rgb, rendering.alpha, rendering.depth]
    weights = [torch.randn(image.shape, generator=rng) for image in images]
    return rendering, torch.autograd.grad(images, list(leaves.values()), weights)


def assert_nothing_is_missed(
    name: BackendName, splats: Splats, view: View, settings: RenderSettings
):
    shown = in_view(splats, view)
    whole, gradients = drawn(name, splats, view, settings)
    if name == "torch":
        clear = replace(splats, opacities=splats.opacities.where(shown, 0))
        fewer, grads = drawn(name, clear, view, settings)
        grads = [gradient[shown] for gradient in grads]
    else:
        fewer, grads = drawn(name, splats.rows(shown), view, settings)
    for image in ("rgb", "alpha", "depth"):
        assert torch.equal(getattr(whole, image), getattr(fewer, image)), image
    for parameter, ours, theirs in zip(PARAMETERS, grads, gradients, strict=True):
        assert torch.equal(ours, theirs[shown]), parameter
        assert (theirs[~shown] == 0).all(), parameter
    return shown


@pytest.mark.slow
@pytest.mark.parametrize("name", ["torch", "numba"])
@settings(max_examples=15)
@given(
    seed=st.integers(0, 10**6),
    turn=st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    place=st.lists(st.floats(-2, 2), min_size=3, max_size=3),
    focal=st.sampled_from([6.0, 30.0, 400.0]),
    antialiased=st.booleans(),
)
def test_without_the_rest_picture_and_gradients_are_the_same(
    name, seed, turn, place, focal, antialiased
):
    """Cameras among the Gaussians, of fields of view from 6 to 147 degrees."""
    asked = RenderSettings(depth=True, antialiased=antialiased)
    shown = assert_nothing_is_missed(name, cloud(seed), view_at(turn, place, focal), asked)
    assert not shown.all()  # some are fainter than the cutoff


@pytest.mark.parametrize("name", ["torch", "numba"])
@pytest.mark.parametrize("focal", [30.0, 400.0])
def test_the_same_at_the_borders(name, focal):
    """Means about where their reach ends, above or below, and within rounding of the near plane; at
    the longer focal length the bound on the Jacobian is what it is."""
    view, n = view_at([0.0] * 3, [0.0] * 3, focal), 300
    rng = torch.Generator().manual_seed(0)
    far = 0.5 + 3 * torch.rand(n // 2, generator=rng)
    z = torch.cat([torch.full((n // 2,), NEAR_PLANE), far])
    z = z * (1 + 2e-7 * torch.randn(n, generator=rng))
    sigma = 10 ** (3 * torch.rand(n, generator=rng) - 1)
    beyond = 3.33 * (sigma.square() + 0.3).sqrt() * (0.95 + 0.1 * torch.rand(n, generator=rng))
    side = torch.rand(n, generator=rng) < 0.5
    x = (torch.rand(n, generator=rng) * WIDTH - view.K[0, 2]) / view.K[0, 0] * z
    pixel = torch.where(side, HEIGHT + beyond, -beyond)
    y = (pixel - view.K[1, 2]) / view.K[1, 1] * z
    splats = Splats(
        means=torch.stack([x, y, z], dim=-1),
        quats=torch.randn(n, 4, generator=rng),
        scales=(sigma * z / view.K[1, 1])[:, None].repeat(1, 3),
        opacities=0.9 + 0.1 * torch.rand(n, generator=rng),
        colors=torch.rand(n, 3, generator=rng),
    )
    shown = assert_nothing_is_missed(name, splats, view, RenderSettings(depth=True))
    assert shown.any()
