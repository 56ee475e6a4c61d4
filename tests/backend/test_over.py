"""The compiled layer over what lies behind it has the bits of its formula, where it is used."""

from __future__ import annotations

from functools import partial

import numba
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.backend import over as module
from desplat_ns.backend.numba_kernels.runtime import numba_config
from desplat_ns.backend.over import in_range, over
from tests.helpers.threads import threads

EPS = torch.finfo(torch.float32).eps
VALUES = st.floats(-2, 2, width=32)


def formula(top: torch.Tensor, alpha: torch.Tensor, below: torch.Tensor) -> torch.Tensor:
    return top + (1 - alpha) * below


def of_size(height: int, width: int, one_colour: bool, seed: int = 0) -> list[torch.Tensor]:
    rng = torch.Generator().manual_seed(seed)
    shapes = ((height, width, 3), (height, width, 1), (3,) if one_colour else (height, width, 3))
    return [2 * torch.rand(shape, generator=rng) - 0.5 for shape in shapes]


def pulled(function, inputs: list[torch.Tensor], wanted: list[bool]) -> list[torch.Tensor]:
    """The colours, and the gradients that are wanted."""
    leaves = [t.clone().requires_grad_(want) for t, want in zip(inputs, wanted, strict=True)]
    out = function(*leaves)
    rng = torch.Generator().manual_seed(9)
    out.backward(torch.randn(out.shape, generator=rng))
    return [out.detach(), *(leaf.grad for leaf in leaves if leaf.grad is not None)]


def formula_in_range(*layers: torch.Tensor) -> torch.Tensor:
    return formula(*layers).clamp(0, 1)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (90, 91)])
@pytest.mark.parametrize("below", [None, False, True])
@pytest.mark.parametrize("cut", [False, True])
def test_colours_and_gradients_are_those_of_the_formula(size, below, cut):
    """`below`: whether an image behind wants a gradient; None for one colour.

    Colours, and gradients of images, are the same products and sums. That of alpha is a sum of
    three products in any order: two roundings of the sum, each of at most 3 max |v below|.
    """
    height, width = size
    inputs, wanted = of_size(height, width, below is None), [True, True, below is True]
    fast = pulled(partial(over, cut=cut), inputs, wanted)
    plain = pulled(formula_in_range if cut else formula, inputs, wanted)
    for place, (a, b) in enumerate(zip(fast, plain, strict=True)):
        if place == 2:
            largest = 6 * inputs[2].abs().max()  # |v| < 6 for a normal number of float32
            assert (a - b).abs().max() <= 2 * EPS * 3 * largest
        else:
            assert torch.equal(a, b)


@pytest.mark.skipif(numba_config.NUMBA_NUM_THREADS < 2, reason="numba has one thread only")
def test_the_bits_are_the_same_for_any_number_of_threads():
    inputs, results = of_size(200, 200, False), []
    for number in (1, 2):
        with threads(number):
            assert numba.get_num_threads() == number
            results.append(pulled(over, inputs, [True] * 3))
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


@given(values=st.lists(VALUES | st.just(float("nan")), min_size=7, max_size=7))
def test_any_pixel_is_as_by_the_formula_and_nan_stays(values):
    numbers = torch.tensor(values).reshape(1, 1, 7)
    inputs = numbers[..., :3], numbers[..., 3:4], numbers[..., 4:]
    assert torch.equal(over(*inputs).nan_to_num(5), formula(*inputs).nan_to_num(5))
    cut = over(*inputs, cut=True)
    assert torch.equal(cut.nan_to_num(5), formula_in_range(*inputs).nan_to_num(5))


@pytest.mark.parametrize("case", ["float64", "two channels", "a colour that is learned"])
def test_what_the_kernels_cannot_do_takes_the_formula(case, monkeypatch):
    monkeypatch.setattr(module, "_Over", None)
    top, alpha, below = of_size(4, 5, one_colour=True)
    if case == "float64":
        top, alpha, below = top.double(), alpha.double(), below.double()
    elif case == "two channels":
        top, below = top[..., :2], below[:2]
    else:
        below.requires_grad_()
    assert torch.equal(over(top, alpha, below), formula(top, alpha, below))
    assert torch.equal(over(top, alpha, below, cut=True), formula_in_range(top, alpha, below))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_colours_in_range_and_their_gradients_are_those_of_a_clamp(dtype):
    nan = float("nan")
    values = torch.tensor([-1.0, -1e-9, -0.0, 0.0, 0.5, 1.0, 1.0000001, 7.0, nan], dtype=dtype)
    values = values.reshape(1, 3, 3)
    leaf, other = values.clone().requires_grad_(), values.clone().requires_grad_()
    cut, expected = in_range(leaf), other.clamp(0, 1)
    assert torch.equal(cut.nan_to_num(5), expected.nan_to_num(5))
    weights = torch.arange(1.0, 10.0, dtype=dtype).reshape(1, 3, 3)
    cut.backward(weights)
    expected.backward(weights)
    assert leaf.grad is not None and other.grad is not None
    assert torch.equal(leaf.grad, other.grad)
    assert leaf.grad.flatten().tolist() == [0, 0, 0, 0, 5, 0, 0, 0, 0]
