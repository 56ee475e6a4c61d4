"""What a page of a scene shows, before it is written.

Letters in shapes: N Gaussians, H x W pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from desplat_ns.backend.protocol import View
from desplat_ns.export.formats import Y_UP
from desplat_ns.export.splat_cloud import Similarity, SplatCloud

AVERAGE = "the photos' average"
"""Whose light is shown where none was chosen."""

Rgb = UInt8[np.ndarray, "_ _ 3"]


TO_PAGE = Similarity(np.asarray(Y_UP, np.float64), 1.0, np.zeros(3))
"""From nerfstudio's coordinates to the page's, where y is up. The scale stays that of training, in
which cameras are at most about one unit from the origin."""


@dataclass(frozen=True)
class PageCamera:
    """A photo's camera, and what belongs to it."""

    name: str
    held_out: bool
    view: View
    """In the coordinates of training."""
    near: float
    """What is nearer is not shown there; world units."""
    reach: float
    """Median depth of what is shown there, world units."""
    photo: Rgb
    distractors: SplatCloud | None = None
    """What was taken out of the photo, in the coordinates of training; None if nothing was."""

    def as_json(self) -> dict[str, Any]:
        """As the page's script reads it: the pose, camera to world in OpenGL's axes, by columns."""
        pose = np.linalg.inv(self.view.viewmat.double().cpu().numpy())
        pose = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3] = TO_PAGE.turn @ pose[:3]
        intrinsics = self.view.K.double().cpu().numpy()
        return {
            "name": self.name,
            "heldOut": self.held_out,
            "size": [self.view.width, self.view.height],
            "lens": [float(intrinsics[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))],
            "pose": pose.T.ravel().tolist(),
            "near": self.near,
            "reach": self.reach,
        }


@dataclass(frozen=True)
class Light:
    """A light in which the scene can be shown."""

    name: str
    """Whose: a photo's."""
    background: tuple[float, float, float]
    """Colour behind everything, in [0, 1]."""
    harmonics: Float[np.ndarray, "N K 3"]
    """Of the scene's Gaussians, as `SplatCloud.harmonics`."""


@dataclass(frozen=True)
class Contents:
    """All that is on a page."""

    title: str
    date: str
    """When the run was trained, in ISO's form."""
    cloud: SplatCloud
    """The static scene, in the coordinates of training."""
    weigh: Callable[[SplatCloud], Float[np.ndarray, " N"]]
    """How much each of its Gaussians makes up of the photos; asked for if not all fit."""
    background: tuple[float, float, float]
    """Colour behind everything, in [0, 1]."""
    light: str
    """Whose light is shown: a photo, a mix, or `AVERAGE`; empty where all photos have the same."""
    cameras: Sequence[PageCamera]
    pictures: Sequence[tuple[str, Rgb]]
    """Renderings with their names, for browsers that cannot draw the scene."""
    other_lights: Sequence[Light] = ()
    """To choose from beside it, the most telling one first."""
    not_shown: str = ""
    """In words, which photos are not on the page."""
