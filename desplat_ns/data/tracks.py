"""Which points a reconstruction found in which photos, read only when somebody asks.

Training does not need them, so the metadata of a capture carries no observations: `Tracks` says
where they lie. Letters in shapes: P points, M observations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
from jaxtyping import Bool, Float, Int

from desplat_ns.errors import CaptureError

if TYPE_CHECKING:
    import pycolmap

METADATA_KEY = "point_tracks"
"""Where the data parser leaves a `Tracks`, beside `points3D_xyz`."""


class Observed(NamedTuple):
    """The points that one photo observes."""

    points: Int[np.ndarray, " M"]
    """Indices into the points of the capture."""
    places: Float[np.ndarray, "M 2"]
    """Where, as fractions of the photo's width and height: the same at every size."""


@dataclass(frozen=True)
class Tracks:
    """Where to read what the photos of a split observe."""

    folder: Path
    """The reconstruction."""
    image_ids: tuple[int, ...]
    """Of the photos, in the order of the split."""
    point_ids: Int[np.ndarray, " P"]
    """Of the capture's points, in their order."""

    def keep(self, which: Bool[np.ndarray, " P"]) -> Tracks:
        """The tracks of some of the points."""
        return replace(self, point_ids=self.point_ids[which])

    def read(self, photos: Sequence[int]) -> list[Observed]:
        """What some photos, given by their numbers in the split, observe.

        Raises:
            CaptureError: the reconstruction cannot be read any more, or has other photos now.
        """
        import pycolmap  # a quarter of a second: not for `--help`

        try:
            images = pycolmap.Reconstruction(self.folder).images
            place = {number: i for i, number in enumerate(self.point_ids.tolist())}
            return [_observed(images[self.image_ids[photo]], place) for photo in photos]
        except (ValueError, LookupError, RuntimeError) as error:
            raise CaptureError(
                f"The observations in {self.folder} cannot be read ({error}); they could when the "
                "capture was opened. Put the reconstruction back, or start again."
            ) from error


def _observed(image: pycolmap.Image, place: Mapping[int, int]) -> Observed:
    """What a photo observes of the points that have a `place` by their number."""
    assert image.camera is not None, "pycolmap links every image to its camera"
    known = [one for one in image.get_observation_points2D() if one.point3D_id in place]
    pixels = np.array([one.xy for one in known], dtype=np.float64).reshape(-1, 2)
    return Observed(
        np.array([place[one.point3D_id] for one in known], dtype=np.int64),
        pixels / (image.camera.width, image.camera.height),
    )
