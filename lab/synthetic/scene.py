"""The capture: twins with and without occluders, extra views, points."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8

from lab.synthetic.cameras import PinholeCamera, arc
from lab.synthetic.daylight import Daylight, develop, draw_daylights
from lab.synthetic.occluders import Effect, occluders_for_view
from lab.synthetic.places import PLACES
from lab.synthetic.points import FEW_VIEWS, PointCloud, mean_colors, sample_points
from lab.synthetic.render import Samples, draw, sky, to_pixels
from lab.synthetic.spec import SceneSpec


@dataclass(frozen=True)
class Frame:
    """One picture and its truth."""

    name: str
    """File name without folder and suffix."""
    camera: PinholeCamera
    image: UInt8[np.ndarray, "H W 3"]
    depth: Float[np.ndarray, "H W"]
    """Of the static scene at pixel centres, metres along the optical axis; infinity in the sky."""
    coverage: Float[np.ndarray, "H W"]
    """Fraction of each pixel that occluders hide; 0 in clean and extra pictures."""
    daylight: Daylight | None = None
    """Light and sky that it was taken in, where the spec asks for any."""

    @property
    def mask(self) -> Bool[np.ndarray, "H W"]:
        """Pixels that belong to occluders: at least half covered."""
        return self.coverage >= 0.5


@dataclass(frozen=True)
class Scene:
    """A generated capture. `clean[i]` and `clutter[i]` are twins."""

    spec: SceneSpec
    clean: list[Frame]
    clutter: list[Frame]
    extra: list[Frame]
    points: PointCloud
    """Its views are the training views, then the extras; occluders are left out of account."""
    folder: Path | None = None
    """Where it was written, if it was."""

    def is_occluded(self) -> Bool[np.ndarray, "V N"]:
        """Whether occluders hide a point that a training view would show."""
        hidden = [self.points.hidden_by(i, f.coverage > 0) for i, f in enumerate(self.clutter)]
        return np.stack(hidden)


def make_cameras(spec: SceneSpec) -> tuple[list[PinholeCamera], list[PinholeCamera]]:
    """Training cameras and extras; the extras stand between training cameras."""
    half, size = np.radians(spec.arc_degrees) / 2, (spec.width, spec.height)
    stand = PLACES[spec.place].stand
    train = np.linspace(-half, half, spec.num_views)
    gaps = np.linspace(1, spec.num_views - 3, spec.num_extras).round().astype(int)
    extra = (train[gaps] + train[gaps + 1]) / 2
    return (
        _vary_sizes(spec, arc(train, size, spec.rng(0), stand), spec.rng(6)),
        _vary_sizes(spec, arc(extra, size, spec.rng(1), stand), spec.rng(7)),
    )


def _vary_sizes(
    spec: SceneSpec, cameras: list[PinholeCamera], rng: np.random.Generator
) -> list[PinholeCamera]:
    """The same cameras, each size of the spec equally often, in random order."""
    if not spec.other_sizes:
        return cameras
    order = rng.permutation(np.arange(len(cameras)) % len(spec.sizes))
    return [camera.with_size(*spec.sizes[i]) for camera, i in zip(cameras, order, strict=True)]


@dataclass(frozen=True)
class _Drawing:
    """What a camera sees of the static scene under a plain sky."""

    camera: PinholeCamera
    samples: Samples
    centers: Samples
    """One sample at the centre of each pixel, without shadows."""
    daylight: Daylight | None
    sunlit: Samples | None = None
    """As `samples` under the photo's own sun, where it has one."""

    @property
    def own(self) -> Samples:
        """What the photo shows, before its light."""
        return self.samples if self.sunlit is None else self.sunlit

    def frame(self, name: str, supersample: int, daylight: Daylight | None) -> Frame:
        samples = self.samples if daylight is None else self.own
        image = develop(samples, self.camera, supersample, daylight)
        depth = self.centers.depth
        return Frame(name, self.camera, image, depth, np.zeros_like(depth), daylight)


def _draw_static(
    spec: SceneSpec, cameras: list[PinholeCamera], rng: np.random.Generator
) -> list[_Drawing]:
    place = PLACES[spec.place]
    things = place.things()
    world = place.around(spec.wall_height) + things
    daylights: list[Daylight | None] = [None] * len(cameras)
    if spec.daylight is not None:
        daylights = [*draw_daylights(spec.daylight, len(cameras), rng)]
    drawings = []
    for camera, daylight in zip(cameras, daylights, strict=True):
        behind = sky(camera, spec.supersample)
        samples = draw(world, camera, spec.supersample, behind, things)
        centers = draw(world, camera, 1, sky(camera, 1))
        sunlit = None
        if daylight is not None and daylight.sun is not None:
            sunlit = draw(world, camera, spec.supersample, behind, things, daylight.sun)
        drawings.append(_Drawing(camera, samples, centers, daylight, sunlit))
    return drawings


class _Crowd:
    """Places the occluders, view by view, so that most of the views that see a point show it."""

    def __init__(self, spec: SceneSpec, points: PointCloud) -> None:
        self.spec, self.points = spec, points
        sightings = points.is_seen[: spec.num_views].sum(axis=0)
        self.views_left = (sightings - 1) // 2
        """How many more views may hide each point."""

    def _effect(self, view: int, new: Bool[np.ndarray, "H W"]) -> Effect:
        worn_out = self.points.hidden_by(view, new) & (self.views_left <= 0)
        return Effect(float(new.mean()), worn_out.sum() / max(1, self.points.is_seen[view].sum()))

    def join(self, view: int, name: str, drawing: _Drawing) -> Frame:
        """The twin of a clean picture: occluders are drawn over its samples."""
        spec, camera = self.spec, drawing.camera
        chosen = occluders_for_view(
            spec.occluders,
            camera,
            view,
            lambda parts: self._effect(view, draw(parts, camera, 1, drawing.centers).is_new),
            spec.rng(2, view),
        )
        samples = draw(chosen, camera, spec.supersample, drawing.own)
        coverage = to_pixels(samples.is_new[None].astype(np.float32), spec.supersample)[..., 0]
        self.views_left -= self.points.hidden_by(view, coverage > 0)
        image = develop(samples, camera, spec.supersample, drawing.daylight)
        return Frame(name, camera, image, drawing.centers.depth, coverage, drawing.daylight)


def _name(spec: SceneSpec, kind: str, index: int) -> str:
    """RobustNeRF's names say what a photo shows; those of tourists' photos are mere numbers."""
    if spec.layout == "robustnerf":
        return f"{kind}_{index + 1:04d}"
    return f"photo_{index + 1 + (spec.num_views if kind == 'extra' else 0):04d}"


def make_scene(spec: SceneSpec) -> Scene:
    """Draw the capture that `spec` describes.

    Poses, points and occluders are the same with and without daylight: it changes colours only.

    Raises ConfigError where the occluders asked for cannot be placed.
    """
    train, extra = make_cameras(spec)
    drawings = _draw_static(spec, train, spec.rng(8)) + _draw_static(spec, extra, spec.rng(9))
    names = [_name(spec, "clean", i) for i in range(len(train))]
    names += [_name(spec, "extra", i) for i in range(len(extra))]
    plain = [d.frame(n, spec.supersample, None) for n, d in zip(names, drawings, strict=True)]
    views = [(frame.camera, frame.image, frame.depth) for frame in plain]
    points = sample_points(views, spec.num_points, spec.rng(3), PLACES[spec.place].bare)
    crowd = _Crowd(spec, points)
    clutter = [
        crowd.join(i, _name(spec, "clutter", i), d) for i, d in enumerate(drawings[: len(train)])
    ]
    if spec.daylight is None:
        clean, extras = plain[: len(train)], plain[len(train) :]
    else:
        lit = [
            d.frame(n, spec.supersample, d.daylight) for n, d in zip(names, drawings, strict=True)
        ]
        clean, extras = lit[: len(train)], lit[len(train) :]
        points = replace(points, rgb=mean_colors(points, [frame.image for frame in lit]))
    scene = Scene(spec, clean, clutter, extras, points)
    return _without_lost_points(scene) if spec.layout == "phototourism" else scene


def _without_lost_points(scene: Scene) -> Scene:
    """Where no clean twins are registered, points that occluders hide too often are not found."""
    shown = scene.points.is_seen.copy()
    shown[: len(scene.clutter)] &= ~scene.is_occluded()
    kept = np.flatnonzero(shown.sum(axis=0) >= FEW_VIEWS)
    return replace(scene, points=scene.points.keep(kept))
