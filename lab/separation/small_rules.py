"""Which rule of the separation loses a thing: the rules of `regions.find_regions`, one by one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float

from desplat_ns.separation import regions as rules
from desplat_ns.separation.grid import pooled
from desplat_ns.separation.layer import DistractorLayer, TrainStep
from desplat_ns.separation.residuals import (
    TYPICAL_WEIGHT,
    ResidualStats,
)

FOUND = 0.3
"""IoU, within a box around the thing, from which it is found."""

MOST = 0.5
"""Share of a thing that a rule has to take for the loss to be its; of a thing that the scene has to
show in that photo for it to be learned."""


@dataclass(frozen=True)
class Judged:
    """What each rule says of a visit, in cells of `grid_of`."""

    excess: Float[np.ndarray, "rows columns"]
    """Over that which is needed at its peak."""
    evidence: Float[np.ndarray, "rows columns"]
    """The same, with what other photos leave unexplained; 0 where nobody knows."""
    is_known: Bool[np.ndarray, "rows columns"]
    has_excess: Bool[np.ndarray, "rows columns"]
    """Its excess is above `weak_excess`."""
    is_weak: Bool[np.ndarray, "rows columns"]
    """Its evidence is, or its excess where nobody knows."""
    has_votes: Bool[np.ndarray, "rows columns"]
    """Static Gaussians there, and not what is usual anywhere, say what is expected."""
    is_foreign: Bool[np.ndarray, "rows columns"]
    """It does not share the scene's detail."""
    connected: Bool[np.ndarray, "rows columns"]
    regions: Bool[np.ndarray, "rows columns"]
    """In the end."""


def judged(layer: DistractorLayer, train_step: TrainStep, params: Any, memory: Any) -> Judged:
    """The rules one by one, as `regions.find_regions` asks them: all that follows the package."""
    config, photo, drawn = layer.config, train_step.photo, train_step.static
    opacities = torch.sigmoid(params["opacities"].detach()[:, 0])
    means2d = drawn.means2d.detach()[0]
    static = rules.StaticView(train_step.static_rgb.detach(), means2d, drawn.visible, opacities)
    stats = ResidualStats.of(memory, len(opacities), layer.num_views, photo.device)
    comparison, stats = rules.compare(photo, static, stats)
    excess = comparison.excess.values
    rows, columns = excess.shape
    alike = rules.shared_detail(comparison.static, comparison.photo)
    is_foreign = pooled(alike[..., None], (columns, rows))[0] <= rules.SHARED_DETAIL
    unexplained = layer.witnesses.unexplained(train_step.index)
    evidence, is_known = rules.evidence_of(comparison.excess, unexplained)
    needed = (rules.PEAK_LEVELS * comparison.excess.level).clamp(
        config.strong_excess, rules.MAX_PEAK
    )
    has_excess, is_weak = excess > config.weak_excess, evidence > config.weak_excess
    strong = (evidence > needed) & is_known
    connected = rules.outlier_regions(is_weak & is_foreign, strong & is_foreign)
    assert train_step.regions is not None
    parts = excess / needed, torch.where(is_known, evidence, 0) / needed, is_known
    parts += has_excess, is_weak, comparison.excess.votes > TYPICAL_WEIGHT
    parts += is_foreign, connected, train_step.regions
    return Judged(*(part.numpy() for part in parts))


def lost_by(judged: Judged, cells: np.ndarray, box: np.ndarray, ghost: float) -> str:
    """The first rule that loses a thing; `found` if none does. The excess loses it where it would
    do so alone, the witness what the excess alone would have found.

    Args:
        cells: of the thing; `box`: around it.
        ghost: how far the static scene shows the thing, see `Sight.ghost`.
    """
    if iou(judged.regions & box, cells) > FOUND:
        return "found"
    strong = cells & (judged.evidence > 1)
    has_witness_against = not strong.any() or judged.is_weak[cells].mean() < 1 - MOST
    losses = {
        "few views": judged.has_votes[cells].mean() < 1 - MOST,
        "learned": ghost > MOST,
        "strong excess": not (cells & (judged.excess > 1)).any(),
        "weak excess": judged.has_excess[cells].mean() < 1 - MOST,
        "nobody knows": has_witness_against and judged.is_known[cells].mean() < 1 - MOST,
        "witness": has_witness_against,
        "shared detail": not (strong & judged.is_foreign).any()
        or (judged.is_weak & judged.is_foreign)[cells].mean() < 1 - MOST,
        "outline": iou(judged.connected & box, cells) > FOUND,
    }
    return next((name for name, is_lost in losses.items() if is_lost), "too large")


def iou(a: np.ndarray, b: np.ndarray) -> float:
    """Of two masks; 0 of empty ones."""
    return float((a & b).sum() / max(1, (a | b).sum()))
