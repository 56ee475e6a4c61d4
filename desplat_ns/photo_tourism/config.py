"""Settings of the per-image effects; sizes and weights are those of B.3."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class AppearanceConfig:
    """Per-image appearance. `effects.appearance` chooses the model, or none."""

    embedding_dim: int = 32
    """Numbers that describe an image, e_j. B.3. The background reads them, too."""
    fourier_frequencies: int = 4
    """Frequencies of the Fourier features at which each Gaussian's own features z_i start; B.3:
    4, which makes 24 of them, sine and cosine along three axes."""
    hidden_layers: int = 2
    """Of the MLP. B.3."""
    hidden_width: int = 128
    """Units in each hidden layer. B.3."""


@dataclass
class BackgroundConfig:
    """A background that depends on the direction and the image. `effects.background` has it."""

    sh_degree: int = 4
    """Of its spherical harmonics. B.3."""
    hidden_layers: int = 3
    """Of the MLP. B.3."""
    hidden_width: int = 128
    """Units in each hidden layer. B.3."""
    lambda_bg: float = 0.15
    """Weight of L_bg, Eq. 12. B.3."""
    max_error: float = 0.003
    """T_eps of Eq. 10 (colours in [0, 1]): how well the background alone has to explain a pixel for
    Gaussians there to be unwanted. B.3."""
