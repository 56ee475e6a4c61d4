"""Settings of the per-image effects; sizes and weights are those of B.3."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from typing import Literal

import torch

from desplat_ns.errors import ConfigError

MlpDtype = Literal["float32", "bfloat16"]

LIMITS = {
    "embedding_dim": (1, 4096),
    "fourier_frequencies": (1, 24),
    "hidden_layers": (1, 64),
    "hidden_width": (1, 16384),
    "sh_degree": (0, 10),
}
"""What sizes may be: from the least that works to more than anyone has used."""


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
    mlp_dtype: MlpDtype = "float32"
    """Of the MLP's products and of what lies between its layers. bfloat16 has 8 bits of mantissa
    and takes about 0.6 of the time; a processor without instructions for it (a CPU needs
    avx512_bf16 or AMX) uses float32. docs/photo_tourism.md has its errors."""


@dataclass
class BackgroundConfig:
    """What lies behind everything, if `effects.background` has it. The network's sizes are of its
    grade `image`."""

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


def check_sizes(config: AppearanceConfig | BackgroundConfig, option: str) -> None:
    """Make sure that a model of these sizes can be built.

    Args:
        option: what `config` is called on the command line.

    Raises:
        ConfigError: names the size that lies outside of `LIMITS`.
    """
    for name in (field.name for field in fields(config) if field.name in LIMITS):
        value, (least, most) = getattr(config, name), LIMITS[name]
        if not least <= value <= most:
            raise ConfigError(
                f"`{option}.{name.replace('_', '-')}` is {value}; it has to be from {least} to "
                f"{most}."
            )


@cache
def has_bfloat16(device_type: str) -> bool:
    """Whether products of bfloat16 have instructions of their own on this kind of device."""
    if device_type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    tests = ("_is_avx512_bf16_supported", "_is_amx_tile_supported")  # torch 2.4 and later
    return device_type == "cpu" and any(getattr(torch.cpu, name, bool)() for name in tests)
