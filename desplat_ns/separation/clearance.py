"""Removes static Gaussians that hang right in front of a training camera.

What stands in one photo alone is cheapest to learn close to its camera, where hardly another view
looks and none objects; a new view that passes there finds it in its way. The seed points say how
far from each camera the scene starts.
"""

from __future__ import annotations

from typing import Any

import torch
from gsplat.strategy.ops import remove
from jaxtyping import Bool, Float
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor, nn
from torch.optim import Optimizer

from desplat_ns.backend.constants import ALPHA_CUTOFF
from desplat_ns.backend.protocol import View
from desplat_ns.console import announce
from desplat_ns.rendering.near_plane import sampled, scene_start
from desplat_ns.rendering.views import image_points, in_image, views_of

EXTINGUISHED = -10.0
"""Logit of an opacity that is never drawn; the next refinement prunes it, or `Clearance.sweep`."""


class Clearance:
    """Makes static Gaussians transparent that are much nearer to a camera than the scene."""

    def __init__(self, share: float, points: Float[Tensor, "P 3"] | None, cameras: Cameras):
        """Args:
        share: of the depth at which the scene starts; nearer than that, nothing static stays.
        points: of the reconstruction; without them nothing is known, and everything stays.
        cameras: the training cameras, shape [V].
        """
        self.depths = [0.0] * len(cameras)
        if share > 0 and points is not None:
            points = sampled(points)
            self.depths = [share * scene_start(points, view) for view in views_of(cameras)]
            blind = self.depths.count(0.0)
            if blind > 0:
                announce(
                    f"{blind} of {len(cameras)} training photos show no 3D point: what hangs "
                    "before their cameras is not removed.",
                    warning=True,
                )

    @torch.no_grad()
    def hide_near_camera(
        self,
        index: int,
        view: View,
        means: Float[Tensor, "N 3"],
        opacities: Float[Tensor, "N 1"],
        visible: Bool[Tensor, " N"],
    ) -> None:
        """Make transparent what hangs before the camera of a training view that was just rendered.

        What has its centre beside the image stays: a bare wall that passes by the camera has no
        points that would tell how near it is.

        Args:
            opacities: logits, which are written into.
            visible: which of them the view shows.
        """
        if self.depths[index] > 0:
            u, v, depth = image_points(means, view)
            near = visible & in_image(u, v, depth) & (depth < self.depths[index])
            opacities.masked_fill_(near[:, None], EXTINGUISHED)

    @torch.no_grad()
    def sweep(
        self, params: nn.ParameterDict, optimizers: dict[str, Optimizer], state: dict[str, Any]
    ) -> None:
        """Remove static Gaussians that are too faint to be drawn, once no refinement does.

        They have no gradient and come back in no view, so no image changes. Nothing happens where
        nothing is cleared, nor where none would be left.

        Args:
            params: raw parameters of the static set.
            optimizers: with one for each of them, by name.
            state: of the strategy; rows of tensors follow.
        """
        if not any(self.depths):
            return
        gone = params["opacities"].flatten().sigmoid() < ALPHA_CUTOFF
        if 0 < int(gone.sum()) < len(gone):
            remove(params, optimizers, state, gone)  # pyright: ignore[reportArgumentType]
