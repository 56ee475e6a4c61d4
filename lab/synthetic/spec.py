"""What decides how a generated capture looks."""

from dataclasses import dataclass, field

import numpy as np

from lab.synthetic.daylight import DaylightSpec
from lab.synthetic.occluders import OccluderSpec


@dataclass(frozen=True)
class SceneSpec:
    """Everything that decides what is generated; the same spec gives the same bits."""

    num_views: int = 24
    """Training views; each comes with occluders (`clutter`) and without (`clean`)."""
    num_extras: int = 6
    """Views for evaluation (`extra`), never with occluders."""
    width: int = 288
    """Of every picture, in pixels, but for `other_sizes`."""
    height: int = 192
    """Of every picture, in pixels, but for `other_sizes`."""
    supersample: int = 2
    """Each pixel is the mean of this number squared of samples."""
    arc_degrees: float = 90.0
    """Arc around the yard on which the cameras stand."""
    wall_height: float = 6.0
    """Metres. Above walls lower than some 4 metres the sky shows."""
    occluders: OccluderSpec = field(default_factory=OccluderSpec)
    num_points: int = 4000
    """Points of the reconstruction, at most."""
    point_noise: float = 0.004
    """Standard deviation of the error of a point's position, metres along each axis."""
    pixel_noise: float = 0.3
    """Standard deviation of the error of an observation, pixels along each axis."""
    seed: int = 0
    daylight: DaylightSpec | None = None
    """Light and sky that differ from photo to photo; None: the same light, and a plain sky."""
    other_sizes: tuple[tuple[int, int], ...] = ()
    """Width and height of further pictures: as many photos of each as of `width` x `height`. They
    have the same angle of view along the longer side."""
    layout: str = "robustnerf"
    """How the files are arranged and named: `robustnerf` or `phototourism`, see `write_scene`."""
    place: str = "yard"
    """`yard`, where everything has texture; `room`: bare walls around glossy things; `grove`:
    trees whose bark and leaves are as fine as a pixel, with the sky around; `facade`: a house
    behind a lawn; `table`: things on a table, with a room far behind."""

    @classmethod
    def tiny(cls, seed: int = 0) -> "SceneSpec":
        """Six views of 48x32 pixels, for tests."""
        return cls(num_views=6, num_extras=2, width=48, height=32, num_points=300, seed=seed)

    @classmethod
    def tourism(cls, seed: int = 0) -> "SceneSpec":
        """Tourists' photos: any daylight, sky, upright and lengthwise; Photo Tourism's layout."""
        return cls(
            width=160,
            height=120,
            wall_height=2.6,
            occluders=OccluderSpec(kinds=("person", "person", "person", "balloon", "parcel")),
            seed=seed,
            daylight=DaylightSpec(),
            other_sizes=((120, 160), (144, 108)),
            layout="phototourism",
        )

    @classmethod
    def facade(cls, num_views: int, seed: int = 0) -> "SceneSpec":
        """A walk past a house behind a lawn, with trees that only photos from its ends show."""
        return cls(
            num_views=num_views,
            width=192,
            height=128,
            arc_degrees=36.0,
            num_points=2500,
            point_noise=0.02,
            seed=seed,
            place="facade",
        )

    @classmethod
    def table_top(cls, num_views: int, seed: int = 0) -> "SceneSpec":
        """More than half around a table; each part of the room behind is in a few photos."""
        return cls(
            num_views=num_views,
            num_extras=8,
            width=192,
            height=128,
            arc_degrees=200.0,
            num_points=3000,
            seed=seed,
            place="table",
        )

    @property
    def sizes(self) -> list[tuple[int, int]]:
        """Width and height in pixels of all kinds of pictures."""
        return [(self.width, self.height), *self.other_sizes]

    def rng(self, *purpose: int) -> np.random.Generator:
        """A generator of its own for each purpose: one more draw here changes nothing there."""
        return np.random.default_rng([self.seed, *purpose])
