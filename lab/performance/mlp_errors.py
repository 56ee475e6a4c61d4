"""How far off the appearance network is in float32 and in bfloat16, against float64.

    python -m lab.performance.mlp_errors                 (seconds)

A network as it is after training: heads that spread gamma by 0.2 and beta by 0.1 or so. Colours are
toned ones in [0, 1]; gradients are those of a random weighting of all colours.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor

from desplat_ns.photo_tourism.appearance import AffineAppearance, fourier_features, toned_color
from lab.pixels.appearance_dial import trained_network

NUM = 50_000


def colors_and_gradients(network: AffineAppearance, dtype: torch.dtype) -> list[Tensor]:
    """Toned colours [N, 3]; gradients by features, embedding and all of the network's weights."""
    rng = torch.Generator().manual_seed(1)
    features = fourier_features(torch.randn(NUM, 3, generator=rng), 4).to(dtype).requires_grad_()
    embedding = (0.5 * torch.randn(32, generator=rng)).to(dtype).requires_grad_()
    zeroth, color = torch.randn(NUM, 3, generator=rng).to(dtype), torch.rand(NUM, 3, generator=rng)
    beta, gamma = network.tones(embedding, features, zeroth)
    toned = toned_color(color.to(dtype), gamma, beta)
    weight = torch.randn(NUM, 3, generator=rng).to(dtype)
    leaves = [features, embedding, *network.parameters()]
    return [toned.detach(), *torch.autograd.grad(toned, leaves, weight)]


def main() -> None:
    """Print the errors of each dtype; those of gradients relative, by their norms."""
    network = trained_network()
    exact = colors_and_gradients(copy.deepcopy(network).double(), torch.float64)
    names = ["features", "embedding", *(name for name, _ in network.named_parameters())]
    for dtype in ("float32", "bfloat16"):
        network.in_bfloat16 = dtype == "bfloat16"
        measured = colors_and_gradients(network, torch.float32)
        off = (measured[0] - exact[0]).abs()
        print(
            f"{dtype}: colours off by {off.square().mean().sqrt():.1e} rms, {off.max():.1e} at most"
        )
        for name, ours, theirs in zip(names, measured[1:], exact[1:], strict=True):
            print(f"    gradient by {name}: {float((ours - theirs).norm() / theirs.norm()):.1e}")


if __name__ == "__main__":
    main()
