"""Watches training for distractors that hide too much of the scene, and warns.

The warnings are about the failure cases of App. C.3. Each is said once in a run, with advice. What
they are based on is seen again within one round of the views, so no checkpoint holds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.protocol import RenderSettings, View
from desplat_ns.console import announce, list_names
from desplat_ns.data.training_views import view_name
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.rendering.layers import MASK_THRESHOLD
from desplat_ns.rendering.views import held, image_points
from desplat_ns.separation.grid import grid_of

CELLS = 2000
"""Cells per image in which it is remembered whether distractors cover it."""

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
"""There is a warning where more than this share of the places is hidden."""

MAX_PLACES = 10_000
"""So many static Gaussians are looked at, evenly chosen."""

MIN_INTERVAL = 200
"""Steps from one look to the next; at least a round of the views."""

MAX_NAMES = 5
"""Photos that a warning names."""


@dataclass
class Sight:
    """A training view when it was last visited, and where distractors covered it."""

    view: View
    covered: Bool[Tensor, "rows columns"]

    @property
    def share(self) -> Float[Tensor, ""]:
        """Share of the image that is covered, in [0, 1]."""
        return self.covered.float().mean()


def sight_of(view: View, alpha_d: Float[Tensor, "H W 1"]) -> Sight:
    """Where distractors cover a view, cell by cell; the pixel in the middle of a cell decides."""
    columns, rows = grid_of(view.width, view.height, CELLS)
    x = ((torch.arange(columns, device=alpha_d.device) + 0.5) * view.width / columns).long()
    y = ((torch.arange(rows, device=alpha_d.device) + 0.5) * view.height / rows).long()
    covered = alpha_d.detach()[y[:, None], x, 0] > MASK_THRESHOLD
    return Sight(held(view), covered)


def seen_and_hidden(
    means: Float[Tensor, "N 3"], sight: Sight
) -> tuple[Bool[Tensor, " N"], Bool[Tensor, " N"]]:
    """Which places are in the image, and which of these a distractor covers.

    Static Gaussians do not hide one another here: a distractor covers all that is behind it.
    """
    rows, columns = sight.covered.shape
    u, v, depth = image_points(means, sight.view)
    column, row = u * columns, v * rows
    seen = depth > RenderSettings.near_plane
    seen = seen & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    cell = torch.where(seen, row.floor() * columns + column.floor(), 0.0).long()
    return seen, seen & sight.covered.flatten()[cell]


@torch.no_grad()
def hidden_places(
    means: Float[Tensor, "N 3"], sights: Sequence[Sight]
) -> tuple[float, Float[Tensor, " V"]]:
    """Find places of the scene that distractors cover in most of the views that see them.

    Returns:
        Of the places that `MIN_VIEWS` views see, the share that is covered in more than `MOSTLY`
        of them (0 where there are none), and for each view how many of those it has covered.
    """
    both = [seen_and_hidden(means, sight) for sight in sights]
    seen, hidden = (torch.stack(flags) for flags in zip(*both, strict=True))
    times_seen = seen.sum(0)
    judged = times_seen >= MIN_VIEWS
    mostly = judged & (hidden.sum(0) > MOSTLY * times_seen)
    share = float(mostly.sum() / judged.sum().clamp(min=1))
    return share, (hidden & mostly).sum(1).float()


class SeparationWatch:
    """Remembers where distractors cover each view, and warns of the failures of App. C.3."""

    def __init__(self, config: DistractorConfig, names: Sequence[str], num_views: int):
        """Args:
        config: of the distractors; steps already scaled.
        names: of the training photos; may be empty.
        """
        self.config = config
        self.names = list(names)
        self.sights: list[Sight | None] = [None] * num_views
        self.interval = max(MIN_INTERVAL, num_views)
        self.start = max(2 * config.static_warmup, config.stop_densify_at // 2)
        """Until then distractors find their places; they may well be too many."""
        self._said: set[str] = set()

    def see(self, index: int, sight: Sight) -> None:
        """Remember the last visit of training view `index`."""
        self.sights[index] = sight

    def look(self, step: int, means: Float[Tensor, "N 3"]) -> None:
        """Warn if it is time to and there is a reason. `means`: of the static Gaussians."""
        if step < self.start or step % self.interval or len(self._said) == 2:
            return
        if 2 * sum(sight is not None for sight in self.sights) <= len(self.sights):
            return
        noticed = self.notice(means)
        if noticed is not None:
            self._say(noticed[0], f"Step {step}: {noticed[1]}")

    def notice(self, means: Float[Tensor, "N 3"]) -> tuple[str, str] | None:
        """The failure that the sights so far show, by its kind and in words; None if there is none.

        Args:
            means: of the static Gaussians.
        """
        known = [(index, sight) for index, sight in enumerate(self.sights) if sight is not None]
        if not known:
            return None
        each = torch.stack([sight.share for _, sight in known]).tolist()
        shares = {index: share for (index, _), share in zip(known, each, strict=True)}
        covered = [index for index, share in shares.items() if share > MAX_COVERED]
        if 2 * len(covered) > len(known):
            return "too many", self._about_too_many(covered, shares)
        stride = max(1, -(-len(means) // MAX_PLACES))
        share, counts = hidden_places(means.detach()[::stride], [sight for _, sight in known])
        if share <= MAX_HIDDEN_PLACES:
            return None
        times = counts.tolist()
        order = sorted(range(len(times)), key=lambda i: -times[i])
        return "places", self._about_places(share, [known[i][0] for i in order if times[i] > 0])

    def _about_too_many(self, covered: list[int], shares: dict[int, float]) -> str:
        worst = sorted(covered, key=lambda index: -shares[index])
        return (
            f"distractors cover more than {MAX_COVERED:.0%} of {len(covered)} of "
            f"{len(shares)} photos, most of {self._listed(worst)}. They begin to explain the "
            "static scene, which cannot be learned behind them. Where the light, the weather or "
            "the sky changes from photo to photo: --pipeline.model.effects.appearance affine, and "
            f"--pipeline.model.effects.background image for the sky. Else {self._dearer()}."
        )

    def _about_places(self, share: float, views: list[int]) -> str:
        return (
            f"{share:.0%} of the static scene is behind distractors in most of the "
            f"photos that see it, above all in {self._listed(views)}. Something may stand in the "
            "same place in many photos: leave some of these out, mask it, or add photos without "
            "it. If it is a part of the scene that changes, as clouds do: "
            "--pipeline.model.effects.appearance affine, --pipeline.model.effects.background image."
            f" If nothing stands there: {self._dearer()}."
        )

    def _dearer(self) -> str:
        """What makes fewer distractors, with the settings of this run."""
        lambda_d = f"--pipeline.model.distractors.lambda-d (now {self.config.lambda_d:g})"
        if self.config.start != "residual":
            return f"a higher {lambda_d}"
        excess = f"--pipeline.model.distractors.strong-excess (now {self.config.strong_excess:g})"
        return f"a higher {excess} or {lambda_d}"

    def _listed(self, views: list[int]) -> str:
        return list_names((view_name(self.names, view) for view in views), MAX_NAMES)

    def _say(self, kind: str, text: str) -> None:
        if kind not in self._said:
            self._said.add(kind)
            announce(text, warning=True)
