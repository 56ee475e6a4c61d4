"""Which points a reconstruction found in which photos, read only when somebody asks.

Training does not need them, so the metadata of a capture carries no observations: `Tracks` says
where they lie. Letters in shapes: P points, M observations.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from desplat_ns.errors import CaptureError

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
    sizes: tuple[tuple[int, int], ...]
    """Width and height of each photo's camera in the reconstruction."""
    point_ids: Int[np.ndarray, " P"]
    """Of the capture's points, in their order, which is ascending."""

    def keep(self, which: Bool[np.ndarray, " P"]) -> Tracks:
        """The tracks of some of the points."""
        return replace(self, point_ids=self.point_ids[which])

    def read(self, photos: Sequence[int]) -> list[Observed]:
        """What some photos, given by their numbers in the split, observe.

        Raises:
            CaptureError: the reconstruction cannot be read any more, or has other photos now.
        """
        wanted = {self.image_ids[photo] for photo in photos}
        try:
            observations = dict(_observations(self.folder, wanted))
            return [self._observed(photo, observations[self.image_ids[photo]]) for photo in photos]
        except (OSError, ValueError, LookupError, struct.error) as error:
            raise CaptureError(
                f"The observations in {self.folder} cannot be read ({error}); they could when the "
                "capture was opened. Put the reconstruction back, or start again."
            ) from error

    def _observed(self, photo: int, observations: np.ndarray) -> Observed:
        """Of what a photo observes, the points that the capture has."""
        if len(self.point_ids) == 0:
            observations = observations[:0]
        points = np.searchsorted(self.point_ids, observations["point"])
        points = np.minimum(points, len(self.point_ids) - 1)
        known = self.point_ids[points] == observations["point"]
        return Observed(points[known], observations["at"][known] / self.sizes[photo])


_OBSERVATION = np.dtype([("at", "<f8", 2), ("point", "<i8")])
"""Pixels, and the number of a point or -1."""

_IMAGE = struct.Struct("<I7dI")
"""Number, rotation, translation, camera; a name that ends with 0 and a count follow."""


def _observations(folder: Path, wanted: set[int]) -> Iterator[tuple[int, np.ndarray]]:
    """The numbers of some images of a COLMAP model, and the observations of each.

    pycolmap reads whole models only, with all points and their tracks. Format: COLMAP's
    `images.bin` and `images.txt`, as 4.2 writes them.
    """
    parts = ("cameras", "images", "points3D")
    if all((folder / f"{part}.bin").is_file() for part in parts):  # pycolmap prefers them, too
        with (folder / "images.bin").open("rb") as file:
            yield from _of_binary(file, wanted)
    else:
        with (folder / "images.txt").open(encoding="utf8") as lines:
            yield from _of_text(lines, wanted)


def _of_binary(file: BinaryIO, wanted: set[int]) -> Iterator[tuple[int, np.ndarray]]:
    (images,) = struct.unpack("<Q", file.read(8))
    for _ in range(images):
        number = _IMAGE.unpack(file.read(_IMAGE.size))[0]
        while file.read(1) not in (b"\0", b""):
            pass
        (count,) = struct.unpack("<Q", file.read(8))
        if number in wanted:
            content = file.read(count * _OBSERVATION.itemsize)
            yield number, np.frombuffer(content, _OBSERVATION, count)
        else:
            file.seek(count * _OBSERVATION.itemsize, 1)


def _of_text(lines: Iterator[str], wanted: set[int]) -> Iterator[tuple[int, np.ndarray]]:
    for line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        number, values = int(line.split(maxsplit=1)[0]), next(lines, "").split()
        if number in wanted:
            observations = np.empty(len(values) // 3, _OBSERVATION)
            observations["at"] = np.array([values[0::3], values[1::3]], dtype=np.float64).T
            observations["point"] = np.array(values[2::3], dtype=np.int64)
            yield number, observations
