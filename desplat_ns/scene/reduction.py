"""A scene that has to fit into so many bytes: what shows least is left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from desplat_ns.errors import ConfigError
from desplat_ns.export.splat_cloud import SplatCloud
from desplat_ns.export.spz import spz_bytes

LEAST = 100
"""Gaussians: with fewer there is no scene to speak of."""

MARGIN = 0.97
"""Of the bytes that are there: a reduced file's Gaussians take a little more each."""


@dataclass(frozen=True)
class Fitted:
    """A cloud as a file, and what was left out for it."""

    content: bytes
    """SPZ."""
    kept: int
    share: float
    """Of the photos that what is kept makes up, in [0, 1]: blending weights over their sum."""


def fitted(
    cloud: SplatCloud, most: int, weigh: Callable[[SplatCloud], Float[np.ndarray, " N"]]
) -> Fitted:
    """The cloud as SPZ of at most so many bytes.

    Args:
        weigh: gives what each Gaussian makes up of the photos; called where not all fit.

    Raises:
        ConfigError: next to none fit.
    """
    content = spz_bytes(cloud)
    if len(content) <= most:
        return Fitted(content, len(cloud), 1.0)
    weights = weigh(cloud)
    order, count = np.argsort(-weights, kind="stable"), len(cloud)
    while len(content) > most:
        count = int(count * min(MARGIN * most / len(content), 0.99))
        if count < LEAST:
            raise ConfigError(
                f"Of {len(cloud)} Gaussians fewer than {LEAST} fit into {max(most, 0) / 1e6:.2f} "
                "MB, which is what the page has left for them. Give it more with --megabytes, or "
                "fewer photos with --training-photos and --held-out-photos."
            )
        chosen = np.zeros(len(cloud), bool)
        chosen[order[:count]] = True
        content = spz_bytes(cloud.rows(chosen))
    return Fitted(content, count, float(weights[order[:count]].sum() / weights.sum()))
