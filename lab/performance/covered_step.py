"""A training step of a view in which something is in the way."""

from __future__ import annotations

import math

import numpy as np
import torch

from desplat_ns.calibration.model_step import ModelStep
from desplat_ns.calibration.scenes import Scene
from desplat_ns.gaussians.distractors import ViewDistractors
from desplat_ns.separation.grid import grid_of, region_pixels
from desplat_ns.separation.placement import distractors_in
from desplat_ns.settings.effects import Effects


class CoveredStep(ModelStep):
    """The photo shows the scene itself, and noise over a share of its middle, where distractors
    are as they are when they have just been placed."""

    def __init__(self, scene: Scene, share: float, effects: Effects | None = None) -> None:
        super().__init__(scene, effects or Effects(distractors=True))
        view, distractors = scene.view, self.model.distractors
        assert distractors is not None
        config = self.model.config.distractors
        columns, rows = grid_of(view.width, view.height, config.per_view)
        across, down = (
            np.abs((np.arange(count) + 0.5) / count - 0.5) < math.sqrt(share) / 2
            for count in (columns, rows)
        )
        cells = down[:, None] & across
        covered = region_pixels(torch.from_numpy(cells), view.height, view.width)
        scenery = self.model(self.camera)["rgb_static"].detach()
        self.photo = torch.where(covered, self.photo, scenery)
        placed = distractors_in(cells, view, self.photo, config)
        distractors.views[0] = ViewDistractors(placed, config.depth)
