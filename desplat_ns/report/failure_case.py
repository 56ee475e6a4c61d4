"""Judges where distractors cover a scene, view by view: the failure cases of App. C.3.

`desplat-report` asks it of a trained model. Letters in shapes: N Gaussians, V views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.constants import NEAR_PLANE
from desplat_ns.backend.protocol import View
from desplat_ns.console import list_names
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.rendering.layers import MASK_THRESHOLD
from desplat_ns.rendering.views import held, image_points
from desplat_ns.separation.grid import grid_of

CELLS = 2000
"""Cells per image in which it is looked at whether distractors cover it."""

MAX_COVERED = 0.5
"""A view of which distractors cover more is covered by them. A median over the views, which is what
separates, needs places to be free in most of them."""

MIN_VIEWS = 8
"""Places that fewer views see are not judged: chance hides them too often."""

MOSTLY = 2 / 3
"""A place is hidden if distractors cover it in more than this share of the views that see it. At
1/2, things over 40% of every photo, anywhere, hide a fifth of the places; at 2/3 one in a
thousand."""

MAX_HIDDEN_PLACES = 0.02
"""It is a failure where more than this share of the places is hidden."""

MAX_PLACES = 10_000
"""So many static Gaussians are looked at, evenly chosen."""

MAX_NAMES = 5
"""Photos that are named."""


@dataclass(frozen=True)
class Coverage:
    """A training view, and where distractors cover it."""

    name: str
    """Of the photo."""
    view: View
    covered: Bool[Tensor, "rows columns"]

    @property
    def share(self) -> Float[Tensor, ""]:
        """Share of the image that is covered, in [0, 1]."""
        return self.covered.float().mean()


def coverage_of(name: str, view: View, alpha_d: Float[Tensor, "H W 1"]) -> Coverage:
    """Where distractors cover a view, cell by cell; the pixel in the middle of a cell decides."""
    columns, rows = grid_of(view.width, view.height, CELLS)
    x = ((torch.arange(columns, device=alpha_d.device) + 0.5) * view.width / columns).long()
    y = ((torch.arange(rows, device=alpha_d.device) + 0.5) * view.height / rows).long()
    covered = alpha_d.detach()[y[:, None], x, 0] > MASK_THRESHOLD
    return Coverage(name, held(view), covered)


def seen_and_hidden(
    means: Float[Tensor, "N 3"], coverage: Coverage
) -> tuple[Bool[Tensor, " N"], Bool[Tensor, " N"]]:
    """Which places are in the image, and which of these a distractor covers.

    Static Gaussians do not hide one another here: a distractor covers all that is behind it.
    """
    rows, columns = coverage.covered.shape
    u, v, depth = image_points(means, coverage.view)
    column, row = u * columns, v * rows
    visible = depth > NEAR_PLANE
    visible = visible & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    cell = torch.where(visible, row.floor() * columns + column.floor(), 0.0).long()
    return visible, visible & coverage.covered.flatten()[cell]


@torch.no_grad()
def hidden_places(
    means: Float[Tensor, "N 3"], coverages: Sequence[Coverage]
) -> tuple[float, Float[Tensor, " V"]]:
    """Find places of the scene that distractors cover in most of the views that see them.

    Returns:
        Of the places that `MIN_VIEWS` views see, the share that is covered in more than `MOSTLY`
        of them (0 where there are none), and for each view how many of those it has covered.
    """
    both = [seen_and_hidden(means, coverage) for coverage in coverages]
    visible, hidden = (torch.stack(flags) for flags in zip(*both, strict=True))
    times_seen = visible.sum(0)
    judged = times_seen >= MIN_VIEWS
    mostly = judged & (hidden.sum(0) > MOSTLY * times_seen)
    share = float(mostly.sum() / judged.sum().clamp(min=1))
    return share, (hidden & mostly).sum(1).float()


def failure_case(
    config: DistractorConfig, means: Float[Tensor, "N 3"], coverages: Sequence[Coverage]
) -> str | None:
    """The failure case that the views show, in words and with advice; None if they show none.

    Args:
        means: of the static Gaussians.
    """
    if not coverages:
        return None
    shares = torch.stack([coverage.share for coverage in coverages]).tolist()
    covered = [i for i, share in enumerate(shares) if share > MAX_COVERED]
    if 2 * len(covered) > len(coverages):
        worst = sorted(covered, key=lambda i: -shares[i])
        return _about_too_many(config, len(coverages), [coverages[i].name for i in worst])
    stride = max(1, -(-len(means) // MAX_PLACES))
    share, counts = hidden_places(means.detach()[::stride], coverages)
    if share <= MAX_HIDDEN_PLACES:
        return None
    times = counts.tolist()
    order = sorted(range(len(times)), key=lambda i: -times[i])
    return _about_places(config, share, [coverages[i].name for i in order if times[i] > 0])


def _about_too_many(config: DistractorConfig, num_views: int, covered: list[str]) -> str:
    return (
        f"distractors cover more than {MAX_COVERED:.0%} of {len(covered)} of "
        f"{num_views} photos, most of {list_names(covered, MAX_NAMES)}. They begin to explain the "
        "static scene, which cannot be learned behind them. Where the light, the weather or "
        "the sky changes from photo to photo: --pipeline.model.effects.appearance affine, and "
        f"--pipeline.model.effects.background image for the sky. Else {_dearer(config)}."
    )


def _about_places(config: DistractorConfig, share: float, views: list[str]) -> str:
    return (
        f"{share:.0%} of the static scene is behind distractors in most of the "
        f"photos that see it, above all in {list_names(views, MAX_NAMES)}. Something may stand in "
        "the same place in many photos: leave some of these out, mask it, or add photos without "
        "it. If it is a part of the scene that changes, as clouds do: "
        "--pipeline.model.effects.appearance affine, --pipeline.model.effects.background image."
        f" If nothing stands there: {_dearer(config)}."
    )


def _dearer(config: DistractorConfig) -> str:
    """What makes fewer distractors, with the settings of the run."""
    lambda_d = f"--pipeline.model.distractors.lambda-d (now {config.lambda_d:g})"
    if config.start != "residual":
        return f"a higher {lambda_d}"
    excess = f"--pipeline.model.distractors.strong-excess (now {config.strong_excess:g})"
    return f"a higher {excess} or {lambda_d}"
