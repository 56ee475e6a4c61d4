"""Settings of the per-image appearance."""

from dataclasses import dataclass

from desplat_ns.core.options import ranged


@dataclass
class AppearanceConfig:
    """Per-image appearance. `effects.appearance` chooses the model, or none."""

    mlp_scale: float = ranged(0.01, "(0, inf)")
    """Factor of the MLP's output. The authors' code has 0.01, made for 200,000 steps; short runs
    need 1."""
