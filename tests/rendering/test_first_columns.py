"""Columns drawn from what they need are those of the whole set, to the last bit.

With torch, whose rounding of a row depends on its place, the others keep their rows, transparent.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.backend import BackendName
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.registry import resolve
from desplat_ns.rendering.first_columns import needed_by_columns, rows_of

WIDTH, HEIGHT, COLUMNS = 50, 20, 23
VIEW = View(torch.eye(4), torch.tensor([[40.0, 0, 25], [0, 40, 10], [0, 0, 1]]), WIDTH, HEIGHT)


def crowd(seed: int, count: int, opacity: float) -> Splats:
    """Gaussians of some pixels, many of them behind others."""
    rng = torch.Generator().manual_seed(seed)
    z = 1 + 4 * torch.rand(count, generator=rng)
    pixel = torch.rand(count, 2, generator=rng) * torch.tensor([WIDTH, HEIGHT])
    means = torch.cat([(pixel - VIEW.K[:2, 2]) / 40 * z[:, None], z[:, None]], dim=1)
    return Splats(
        means=means,
        quats=torch.randn(count, 4, generator=rng),
        scales=(0.3 + 3 * torch.rand(count, 3, generator=rng)) / 40 * z[:, None],
        opacities=opacity + (1 - opacity) * torch.rand(count, generator=rng),
        colors=torch.rand(count, 3, generator=rng),
    )


def of_columns(name: BackendName, splats: Splats) -> list[torch.Tensor]:
    drawn = resolve(name, "cpu")(splats, VIEW, RenderSettings())
    return [drawn.rgb[:, :COLUMNS], drawn.alpha[:, :COLUMNS]]


@pytest.mark.parametrize("name", ["torch", "numba"])
@given(seed=st.integers(0, 10**6), opacity=st.sampled_from([0.02, 0.5, 0.95]))
def test_the_columns_are_the_same_bits_from_fewer(name, seed, opacity):
    splats = crowd(seed, 400, opacity)
    needed = needed_by_columns(resolve(name, "cpu"), splats, VIEW, RenderSettings(), COLUMNS)
    if name == "numba":
        assert needed.float().mean() < 0.7
    if name == "torch":
        fewer = of_columns(name, replace(splats, opacities=splats.opacities.where(needed, 0)))
    else:
        fewer = of_columns(name, rows_of(splats, needed))
    whole = of_columns(name, splats)
    assert all(torch.equal(a, b) for a, b in zip(whole, fewer, strict=True))


def test_one_that_ends_a_pixel_is_needed_though_it_shows_nowhere():
    """Two leave 1.01e-4 in the middle of a pixel. The third, of one pixel and an opacity of 0.02,
    would leave less than 1e-4: it ends the pixel unseen. Without it the fourth would be blended,
    which is fainter, and needed for what it shows elsewhere."""
    opaque = 1 - 1.01e-4**0.5
    x = (12.5 - 25) / 40
    splats = Splats(
        means=torch.tensor([[x * z, 0.5 / 40 * z, z] for z in (1.0, 1.1, 1.2, 1.3)]),
        quats=torch.tensor([[1.0, 0, 0, 0]]).repeat(4, 1),
        scales=torch.tensor([0.1, 0.1, 1e-5, 5.0])[:, None].repeat(1, 3),
        opacities=torch.tensor([opaque, opaque, 0.02, 0.005]),
        colors=torch.rand(4, 3),
    )
    numba = resolve("numba", "cpu")
    ends = torch.tensor([True, True, False, True])
    differs = of_columns("numba", splats)[1] != of_columns("numba", rows_of(splats, ends))[1]
    assert differs.sum() == 1 and differs[10, 12, 0]
    needed = needed_by_columns(numba, splats, VIEW, RenderSettings(), COLUMNS)
    assert needed.tolist() == [True, True, True, True]
    alone = rows_of(splats, torch.tensor([True, True, True, False]))
    needed = needed_by_columns(numba, alone, VIEW, RenderSettings(), COLUMNS)
    assert needed.tolist() == [True, True, False]


def test_what_only_the_others_show_is_left_out():
    splats = crowd(0, 200, 0.1)
    far_right = replace(splats, means=splats.means + torch.tensor([60.0, 0, 0]))
    rasterizer = resolve("torch", "cpu")
    needed = needed_by_columns(rasterizer, far_right, VIEW, RenderSettings(), COLUMNS)
    assert not needed.any()
