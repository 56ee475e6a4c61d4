"""Judges where photos do not show the static scene, view by view: the failure cases of App. C.3.

`desplat-report` asks it of a trained model. Letters in shapes: N Gaussians, V views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from desplat_ns.backend.constants import NEAR_PLANE
from desplat_ns.backend.protocol import View
from desplat_ns.console import list_names
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.rendering.layers import MASK_THRESHOLD
from desplat_ns.rendering.views import held, image_points
from desplat_ns.separation.grid import grid_of, pooled, region_pixels
from desplat_ns.separation.regions import differences

CELLS = 2000
"""Cells per image in which it is looked at whether it shows the static scene."""

MAX_COVERED = 0.5
"""A view of which distractors cover more is covered by them. A median over the views, which is what
separates, needs places to be free in most of them."""

MIN_VIEWS = 5
"""Places that fewer views see are not judged: chance hides them too often."""

MAX_DISPUTED = 0.02
"""Nobody can tell what the scene is where, in more than half of the views that see them, more than
this share of its places is not what the static scene shows there. Where things stand elsewhere in
each photo, pasted over a fifth of it, it is 0.1%, and 1% of a thin tree before a bright sky."""

MAX_PLACES = 10_000
"""So many static Gaussians are looked at, evenly chosen."""

MAX_NAMES = 5
"""Photos that are named."""


@dataclass(frozen=True)
class Coverage:
    """A training view, where distractors cover it, and where it does not show the static scene."""

    name: str
    """Of the photo."""
    view: View
    covered: Float[Tensor, ""]
    """Share of the image that distractors cover, in [0, 1]."""
    unlike: Bool[Tensor, "rows columns"]
    """Cells that differ from the static scene, whether distractors cover them or not."""


@dataclass(frozen=True)
class Failure:
    """A failure case, in words."""

    what: str
    advice: str
    name: str = ""
    """Of the photo that shows most of it; empty where all of a photo does."""
    where: Bool[np.ndarray, "rows columns"] | None = None
    """In that photo."""


def coverage_of(
    name: str,
    view: View,
    alpha_d: Float[Tensor, "H W 1"],
    photo: Float[Tensor, "H W 3"],
    static: Float[Tensor, "H W 3"],
    config: DistractorConfig,
) -> Coverage:
    """How a photo differs from the static scene.

    Args:
        photo: in [0, 1]; under the user's mask as the static scene.
        static: in the photo's light, in [0, 1].
    """
    covered = (alpha_d.detach() > MASK_THRESHOLD).float()
    unlike = region_pixels(differences(photo, static, config).float(), view.height, view.width)
    cells = pooled(torch.maximum(covered, unlike), grid_of(view.width, view.height, CELLS))[0]
    return Coverage(name, held(view), covered.mean(), cells > 0.5)


def seen_and_unlike(
    means: Float[Tensor, "N 3"], coverage: Coverage
) -> tuple[Bool[Tensor, " N"], Bool[Tensor, " N"], Int[Tensor, " N"]]:
    """Which places are in the image, which of these it does not show, and their cells.

    Static Gaussians do not hide one another here: what is in the way hides all that is behind it.
    """
    rows, columns = coverage.unlike.shape
    u, v, depth = image_points(means, coverage.view)
    column, row = u * columns, v * rows
    visible = depth > NEAR_PLANE
    visible = visible & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    cell = torch.where(visible, row.floor() * columns + column.floor(), 0.0).long()
    return visible, visible & coverage.unlike.flatten()[cell], cell


@torch.no_grad()
def disputed_places(
    means: Float[Tensor, "N 3"], coverages: Sequence[Coverage]
) -> tuple[float, Bool[Tensor, "V cells"]]:
    """Find places of the scene that most of the views that see them do not show.

    Returns:
        Their share of the places that `MIN_VIEWS` views see (0 where there are none), and for each
        view the cells in which it does not show them.
    """
    found = [seen_and_unlike(means, coverage) for coverage in coverages]
    visible, unlike, cells = (torch.stack(part) for part in zip(*found, strict=True))
    times_seen = visible.sum(0)
    judged = times_seen >= MIN_VIEWS
    disputed = judged & (2 * unlike.sum(0) > times_seen)
    share = float(disputed.sum() / judged.sum().clamp(min=1))
    counts = torch.zeros(len(coverages), coverages[0].unlike.numel(), device=cells.device)
    return share, counts.scatter_add(1, cells, (unlike & disputed).float()) > 0


def failure_case(
    config: DistractorConfig, means: Float[Tensor, "N 3"], coverages: Sequence[Coverage]
) -> Failure | None:
    """The failure case that the views show, with advice; None if they show none.

    Args:
        means: of the static Gaussians.
    """
    if not coverages:
        return None
    shares = torch.stack([coverage.covered for coverage in coverages]).tolist()
    covered = [i for i, share in enumerate(shares) if share > MAX_COVERED]
    if 2 * len(covered) > len(coverages):
        worst = sorted(covered, key=lambda i: -shares[i])
        return _about_too_many(config, len(coverages), [coverages[i].name for i in worst])
    stride = max(1, -(-len(means) // MAX_PLACES))
    share, cells = disputed_places(means.detach()[::stride], coverages)
    if share <= MAX_DISPUTED:
        return None
    counts = cells.sum(dim=1).tolist()
    order = sorted((i for i, n in enumerate(counts) if n > 0), key=lambda i: -counts[i])
    where = cells[order[0]].reshape(coverages[order[0]].unlike.shape)
    return _about_places(share, [coverages[i].name for i in order], where.cpu().numpy())


def _about_too_many(config: DistractorConfig, num_views: int, covered: list[str]) -> Failure:
    return Failure(
        f"Distractors cover more than {MAX_COVERED:.0%} of {len(covered)} of "
        f"{num_views} photos, most of {list_names(covered, MAX_NAMES)}.",
        "They begin to explain the "
        "static scene, which cannot be learned behind them. Where the light, the weather or "
        "the sky changes from photo to photo: --pipeline.model.effects.appearance affine, and "
        f"--pipeline.model.effects.background image for the sky. Else {_dearer(config)}.",
    )


def _about_places(share: float, names: list[str], where: np.ndarray) -> Failure:
    return Failure(
        f"Of {share:.0%} of the scene nobody can tell what it is: most photos that see it show "
        f"something else there, above all {list_names(names, MAX_NAMES)}.",
        "Something may stand in the same place in many photos, and be in the static scene now: "
        "leave some of these photos out, mask it, or add photos without it. If it is a part of "
        "the scene that changes, as clouds do: --pipeline.model.effects.appearance affine, "
        "--pipeline.model.effects.background image.",
        names[0],
        where,
    )


def _dearer(config: DistractorConfig) -> str:
    """What makes fewer distractors, with the settings of the run."""
    lambda_d = f"--pipeline.model.distractors.lambda-d (now {config.lambda_d:g})"
    if config.start != "residual":
        return f"a higher {lambda_d}"
    excess = f"--pipeline.model.distractors.strong-excess (now {config.strong_excess:g})"
    return f"a higher {excess} or {lambda_d}"
