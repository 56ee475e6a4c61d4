"""A scene that has to fit into so many bytes: what shows least is left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

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
    rows: Bool[np.ndarray, " N"]
    """Which of the cloud's Gaussians are kept."""
    share: float
    """Of the photos that what is kept makes up, in [0, 1]: blending weights over their sum."""

    @property
    def kept(self) -> int:
        """How many."""
        return int(self.rows.sum())


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
        return Fitted(content, np.ones(len(cloud), bool), 1.0)
    weights = weigh(cloud)
    order, count = np.argsort(-weights, kind="stable"), len(cloud)
    chosen = np.ones(count, bool)
    while len(content) > most:
        count = int(count * min(MARGIN * most / len(content), 0.99))
        if count < LEAST:
            raise ConfigError(
                f"Of {len(cloud)} Gaussians fewer than {LEAST} fit into {max(most, 0) / 1e6:.2f} "
                "MB, which is what the page has left for them. Give it more with --megabytes, or "
                "fewer photos with --training-photos and --held-out-photos."
            )
        chosen[:] = False
        chosen[order[:count]] = True
        content = spz_bytes(cloud.rows(chosen))
    return Fitted(content, chosen, float(weights[order[:count]].sum() / weights.sum()))
