"""Settings of the per-image effects; weights are those of B.3."""

from __future__ import annotations

from dataclasses import dataclass

from desplat_ns.core.options import ranged


@dataclass
class AppearanceConfig:
    """Per-image appearance. `effects.appearance` chooses the model, or none."""

    fourier_frequencies: int = ranged(4, "[1, 24]")
    """Frequencies of the Fourier features at which each Gaussian's own features z_i start; B.3:
    4, which makes 24 of them, sine and cosine along three axes."""
    mlp_scale: float = ranged(0.01, "(0, inf)")
    """Factor of the MLP's output. The authors' code has 0.01, made for 200,000 steps; short runs
    need 1."""


@dataclass
class BackgroundConfig:
    """What lies behind everything, if `effects.background` has it."""

    lambda_bg: float = ranged(0.15, "[0, inf)")
    """Weight of L_bg, Eq. 12. B.3."""
    max_error: float = ranged(0.003, "[0, inf)")
    """T_eps of Eq. 10 (colours in [0, 1]): how well the background alone has to explain a pixel for
    Gaussians there to be unwanted. B.3."""
