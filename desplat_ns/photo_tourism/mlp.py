"""The small networks of appearance and background."""

from __future__ import annotations

from torch import nn


def hidden_layers(inputs: int, layers: int, width: int) -> nn.Sequential:
    """`layers` linear layers of `width` units, a ReLU after each, where they lie in the cache."""
    modules: list[nn.Module] = []
    for i in range(layers):
        modules += [nn.Linear(inputs if i == 0 else width, width), nn.ReLU(inplace=True)]
    return nn.Sequential(*modules)


def zero_head(inputs: int, outputs: int) -> nn.Linear:
    """A linear layer that gives 0 until it is trained."""
    head = nn.Linear(inputs, outputs)
    nn.init.zeros_(head.weight)
    nn.init.zeros_(head.bias)
    return head
