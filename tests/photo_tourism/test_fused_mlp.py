"""The network by blocks is that of torch's modules: values, gradients, the same bits twice."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn
from torch.autograd import gradcheck

from desplat_ns.photo_tourism import fused_mlp
from desplat_ns.photo_tourism.fused_mlp import Layers, mlp_of_rows

NUM, WIDTHS, SPLIT = 50, (7, 9, 8, 3), (4, 3)
"""Rows; inputs, hidden layers, outputs; columns of the parts."""


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several blocks, the last one shorter."""
    dtypes = (torch.float32, torch.float64, torch.bfloat16)
    monkeypatch.setattr(fused_mlp, "COLUMNS", dict.fromkeys(dtypes, 16))


def random_inputs(
    dtype: torch.dtype, widths: tuple[int, ...] = WIDTHS
) -> tuple[list[Tensor], Layers]:
    rng = torch.Generator().manual_seed(0)

    def leaf(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=rng, dtype=torch.float64).to(dtype).requires_grad_()

    pairs = list(zip(widths[1:], widths, strict=False))
    parts = [leaf(NUM, width) for width in SPLIT]
    return parts, Layers([leaf(*shape) for shape in pairs], [leaf(n) for n, _ in pairs])


def leaves_of(parts: list[Tensor], layers: Layers) -> list[Tensor]:
    return [*parts, *layers.weights, *layers.biases]


def by_modules(parts: list[Tensor], layers: Layers) -> Tensor:
    """torch's own layers, one after the other."""
    h = torch.cat(parts, dim=1)
    for i, (weight, bias) in enumerate(zip(layers.weights, layers.biases, strict=True)):
        h = nn.functional.linear(h, weight, bias)
        if i < len(layers.weights) - 1:
            h = torch.relu(h)
    return h


def in_float64(parts: list[Tensor], layers: Layers) -> tuple[list[Tensor], Layers]:
    """The same numbers as leaves of float64."""
    found = [t.detach().double().requires_grad_() for t in leaves_of(parts, layers)]
    n, depth = len(parts), len(layers.weights)
    return found[:n], Layers(found[n : n + depth], found[n + depth :])


def absolute(parts: list[Tensor], layers: Layers) -> tuple[list[Tensor], Layers]:
    """The network of absolute values: all units are on, nothing cancels."""
    with torch.no_grad():
        parts, layers = in_float64(parts, layers)
        for t in leaves_of(parts, layers):
            t.abs_()
    return parts, layers


@pytest.mark.parametrize("widths", [WIDTHS, (7, 5, 2), (7, 4)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_values_and_gradients_are_those_of_modules(widths, dtype):
    """Every number is a sum of products along the network's paths. Rounding is at most a unit in
    the last place for each operation on a path, of the same sum with absolute values."""
    parts, layers = random_inputs(dtype, widths)
    results = []
    for network, (ins, through) in (
        (mlp_of_rows, (parts, layers)),
        (by_modules, in_float64(parts, layers)),
        (by_modules, absolute(parts, layers)),
    ):
        out = network(ins, through)
        weight = torch.ones_like(out)
        results.append([out, *torch.autograd.grad(out, leaves_of(ins, through), weight)])
    operations = 2 * (sum(widths) + NUM)
    for ours, exact, bound in zip(*results, strict=True):
        error = (ours - exact).abs()
        assert (error <= operations * torch.finfo(dtype).eps * bound).all()


def test_gradcheck():
    parts, layers = random_inputs(torch.float64)
    leaves, rows = leaves_of(parts, layers), torch.randperm(NUM)[:30]

    def outputs(*tensors: Tensor) -> Tensor:
        n = len(WIDTHS) - 1
        return mlp_of_rows(tensors[:2], Layers(tensors[2 : 2 + n], tensors[2 + n :]), rows)

    assert gradcheck(outputs, leaves)


def test_rows_that_are_left_out_are_zero_and_get_no_gradient():
    parts, layers = random_inputs(torch.float64)
    rows = torch.tensor([3, 4, 8, 40])
    seen = mlp_of_rows(parts, layers, rows)
    others = torch.ones(NUM, dtype=torch.bool)
    others[rows] = False
    torch.testing.assert_close(seen[rows], by_modules(parts, layers)[rows])
    assert (seen[others] == 0).all()
    for gradient in torch.autograd.grad(seen.square().sum(), parts):
        assert (gradient[others] == 0).all() and (gradient[rows] != 0).any(1).all()


@pytest.mark.parametrize("rows", [None, torch.zeros(0, dtype=torch.int64)])
def test_no_rows_at_all(rows):
    parts, layers = random_inputs(torch.float32)
    if rows is None:
        parts = [part[:0].detach().requires_grad_() for part in parts]
    seen = mlp_of_rows(parts, layers, rows)
    assert seen.shape == (len(parts[0]), WIDTHS[-1]) and (seen == 0).all()
    for gradient in torch.autograd.grad(seen.sum(), leaves_of(parts, layers)):
        assert (gradient == 0).all()


def test_the_same_bits_every_time_and_beside_others():
    """Memory is used again: neither a graph in between nor a second backward pass disturbs."""
    parts, layers = random_inputs(torch.float32)
    leaves = leaves_of(parts, layers)
    first = mlp_of_rows(parts, layers)
    wanted = torch.autograd.grad(first.square().sum(), leaves)
    one, other = mlp_of_rows(parts, layers), mlp_of_rows([2 * p for p in parts], layers)
    with torch.no_grad():
        assert torch.equal(mlp_of_rows(parts, layers), first)
    torch.autograd.grad(other.sum(), leaves)
    for _ in range(2):
        found = torch.autograd.grad(one.square().sum(), leaves, retain_graph=True)
        assert all(torch.equal(a, b) for a, b in zip(found, wanted, strict=True))


@pytest.mark.parametrize("needed", range(2 + 2 * (len(WIDTHS) - 1)))
def test_each_gradient_alone_is_that_of_all(needed):
    parts, layers = random_inputs(torch.float32)
    wanted = torch.autograd.grad(
        mlp_of_rows(parts, layers).square().sum(), leaves_of(parts, layers)
    )
    tensors = [
        t.detach().requires_grad_(i == needed) for i, t in enumerate(leaves_of(parts, layers))
    ]
    n = len(WIDTHS) - 1
    seen = mlp_of_rows(tensors[:2], Layers(tensors[2 : 2 + n], tensors[2 + n :]))
    seen.square().sum().backward()
    assert torch.equal(tensors[needed].grad, wanted[needed])
    assert all(t.grad is None for i, t in enumerate(tensors) if i != needed)


def test_detached_layers_get_no_gradient():
    parts, layers = random_inputs(torch.float32)
    seen = mlp_of_rows(parts, layers.detached())
    assert torch.equal(seen, mlp_of_rows(parts, layers))
    seen.sum().backward()
    assert parts[0].grad is not None and layers.weights[0].grad is None


def test_bfloat16_is_off_by_its_rounding_and_sums_gradients_in_float32():
    """Each layer rounds its input, weights and output to 8 bits; errors pass on by the layers'
    absolute weights."""
    parts, layers = random_inputs(torch.float32)
    seen = mlp_of_rows(parts, layers, dtype=torch.bfloat16)
    assert seen.dtype == torch.float32
    h, unit = torch.cat(parts, dim=1).double(), 2.0**-8
    error = torch.zeros_like(h)
    for i, (weight, bias) in enumerate(zip(layers.weights, layers.biases, strict=True)):
        w, b = weight.double(), bias.double()
        total = h.abs() @ w.abs().T + b.abs()
        error = error @ w.abs().T + 4 * unit * total
        h = h @ w.T + b
        h = torch.relu(h) if i < len(layers.weights) - 1 else h
    assert ((seen - h).abs() <= error).all()
    assert not torch.equal(seen, mlp_of_rows(parts, layers))
    gradients = torch.autograd.grad(seen.sum(), leaves_of(parts, layers))
    assert all(gradient.dtype == torch.float32 for gradient in gradients)


def test_memory_of_the_cpu_is_not_given_to_another_device():
    """As in a process that trains on both: memory is kept from one step to the next."""
    parts, layers = random_inputs(torch.float32)
    mlp_of_rows(parts, layers).sum().backward()
    elsewhere = Layers(*([t.to("meta") for t in half] for half in (layers.weights, layers.biases)))
    assert mlp_of_rows([part.to("meta") for part in parts], elsewhere).device.type == "meta"
