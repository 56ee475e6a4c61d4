"""Puts distractors where a photo shows what the other views do not, and removes them elsewhere.

Eq. 5 alone leaves the sets a choice: while a distractor is faint, both get the same gradient, and
once the composite fits, neither gets any (docs/separation.md works it out for one pixel). What is
added here decides: distractors start only where a photo shows what the other views do not, are
removed where it does not, and the static scene has to fit by itself all pixels that they leave.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.optim import Optimizer

from desplat_ns.backend.protocol import View
from desplat_ns.console import announce
from desplat_ns.gaussians.densification import DistractorDensifier
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import DistractorGaussians, distractors_at
from desplat_ns.gaussians.memory import GaussianMemory
from desplat_ns.rendering.views import image_points
from desplat_ns.separation.expected_residual import LEAST_VIEWS, UsualResiduals
from desplat_ns.separation.finding import find_regions
from desplat_ns.separation.grid import counted_cells, grid_of, pooled
from desplat_ns.separation.last_regions import LastRegions
from desplat_ns.separation.ownership import pixels_of
from desplat_ns.separation.transfers import masks_to_host, to_device
from desplat_ns.separation.visit import Visit

FEW_VIEWS = 5
"""With fewer training photos a warning is said: of three, two that are occluded alike outvote the
third."""

COVERED_SHARE = 0.5
"""A distractor is placed where more than this share of its cell is inside a region, and where the
distractors' mean opacity is less than it."""


def uncovered_regions(
    visit: Visit, config: DistractorConfig
) -> Bool[Tensor, "grid_rows grid_columns"]:
    """Cells in which distractors belong and none covers much, of a grid of `config.per_view`;
    masked ones are left out."""
    assert visit.inside is not None
    grid = grid_of(visit.view.width, visit.view.height, max(1, config.per_view))
    inside = pooled(visit.inside[..., None].to(torch.float32), grid)[0]
    covered = pooled(visit.alpha_d.detach(), grid)[0]
    wanted = (inside >= COVERED_SHARE) & (covered < COVERED_SHARE)
    return wanted if visit.mask is None else wanted & counted_cells(visit.mask, grid)


def distractors_in(
    cells: Bool[np.ndarray, "grid_rows grid_columns"], visit: Visit, config: DistractorConfig
) -> dict[str, Tensor]:
    """New distractors in the photo's colours, one for each cell that is set, on the host."""
    rows, columns = cells.shape
    row, column = to_device(np.stack(cells.nonzero()), visit.photo.device)
    x = (column + 0.5) * visit.view.width / columns
    y = (row + 0.5) * visit.view.height / rows
    colors = pooled(visit.photo, (columns, rows), visit.mask)[:, row, column].T.contiguous()
    return distractors_at(visit.view, config, torch.stack([x, y], dim=-1), colors)


def lie_in(
    regions: Bool[Tensor, "rows columns"], means: Float[Tensor, "N 3"], view: View
) -> Bool[Tensor, " N"]:
    """Which Gaussians have their centre in a region; beyond the border, the nearest cell counts."""
    rows, columns = regions.shape
    u, v, _ = image_points(means.detach(), view)
    row, column = (v * rows).long(), (u * columns).long()
    return regions[row.clamp(0, rows - 1), column.clamp(0, columns - 1)]


def about_few_views(num_views: int) -> str:
    """What a user is told who trains on fewer than `FEW_VIEWS` photos."""
    found = f"There are {num_views} training photos. What is in the way is told from the scene by "
    if num_views <= LEAST_VIEWS:
        return (
            f"{found}what most photos of a place show: {LEAST_VIEWS + 1} at least. So distractors "
            "cannot be judged, and none is placed. Add photos, or mask what is in the way."
        )
    return (
        f"{found}what most photos of a place show, and with fewer than {FEW_VIEWS} that is easily "
        "wrong. Look at the distractor masks before trusting them; more photos help."
    )


class Placement:
    """Finds where each view's distractors belong, and moves them there after the optimizers."""

    def __init__(self, config: DistractorConfig, num_views: int):
        """Says so where there are too few views to judge by."""
        self.config = config
        self.num_views = num_views
        self.last = LastRegions()
        if config.start == "residual" and num_views < FEW_VIEWS:
            announce(about_few_views(num_views), warning=True)

    @torch.no_grad()
    def look(
        self,
        step: int,
        visit: Visit,
        opacities: Float[Tensor, "N 1"],
        memory: GaussianMemory,
    ) -> Bool[Tensor, "H W 1"] | None:
        """Find the view's regions, and note in the visit what follows from them.

        Nothing is found where nobody has a say, with `LEAST_VIEWS` views or fewer.

        Args:
            opacities: of the static Gaussians, logits.
            memory: what they remember; it is read only.

        Returns:
            The pixels in which opacity is free; None if nothing is found, or in the warm-up, in
            which views are only remembered.
        """
        if self.num_views <= LEAST_VIEWS:
            return None
        config, last = self.config, None
        standing = config.standing_share < 1 and step < config.leave_out_at
        if standing:
            last = self.last.of(visit)
        known = UsualResiduals.of(memory, len(opacities), visit.photo.device)
        regions, visit.learned = find_regions(visit, opacities, known, self.num_views, config, last)
        if step < config.static_warmup:
            return None
        if standing:
            visit.standing = regions
        if step < config.stop_placing_at:
            visit.inside = regions
        if step >= config.leave_out_at:
            visit.left_out = regions
        return pixels_of(regions, *visit.photo.shape[:2])

    def keep(self, visit: Visit) -> None:
        """Take up what was found in a sound visit."""
        self.last.keep(visit)

    def state_dict(self) -> dict[str, Any]:
        """What was found so far, for a checkpoint."""
        return {"regions": self.last.state_dict()}

    def load_state_dict(self, state: dict[str, Any], device: torch.device) -> None:
        """Take up what `state_dict` gave, on `device`; earlier checkpoints lack it."""
        if "regions" in state:
            self.last.load_state_dict(state["regions"], device)

    @torch.no_grad()
    def place(
        self,
        visit: Visit,
        distractors: DistractorGaussians,
        densifier: DistractorDensifier,
        optimizers: dict[str, Optimizer],
    ) -> None:
        """Give the view new distractors where they belong, and remove those out of place."""
        if visit.inside is None:
            return
        stays = lie_in(visit.inside, distractors.params_of(visit.index)["means"], visit.view)
        stays, uncovered = masks_to_host(stays, uncovered_regions(visit, self.config))
        if uncovered.any() or not stays.all():
            kept = to_device(np.flatnonzero(stays), visit.photo.device)
            new = distractors_in(uncovered, visit, self.config)
            densifier.exchange(distractors, visit.index, optimizers, kept, new)
