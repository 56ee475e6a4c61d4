"""The capture: twins with and without occluders, extra views, points; in memory or on disk."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8

from desplat_ns.data.images import write_image
from desplat_ns.errors import ConfigError
from desplat_ns.synthetic.cameras import PinholeCamera, arc
from desplat_ns.synthetic.colmap_export import RegisteredPhoto, write_reconstruction
from desplat_ns.synthetic.occluders import Effect, OccluderSpec, occluders_for_view
from desplat_ns.synthetic.points import PointCloud, sample_points
from desplat_ns.synthetic.render import Samples, draw, sky, to_pixels, to_uint8
from desplat_ns.synthetic.yard import furniture, walls_and_ground


@dataclass(frozen=True)
class SceneSpec:
    """Everything that decides what is generated; the same spec gives the same bits."""

    num_views: int = 24
    """Training views; each comes with occluders (`clutter`) and without (`clean`)."""
    num_extras: int = 6
    """Views for evaluation (`extra`), never with occluders."""
    width: int = 288
    """Of every picture, in pixels."""
    height: int = 192
    """Of every picture, in pixels."""
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

    def __post_init__(self) -> None:
        if self.num_views < 3 or self.num_extras < 1:
            raise ConfigError(
                f"A scene of {self.num_views} views and {self.num_extras} extras is too small: "
                "set num_views to 3 or more and num_extras to 1 or more."
            )
        if min(self.width, self.height) < 16 or self.supersample < 1:
            raise ConfigError(
                f"Pictures of {self.width}x{self.height} with supersample {self.supersample} "
                "cannot be drawn: set width and height to 16 or more, supersample to 1 or more."
            )

    @classmethod
    def tiny(cls, seed: int = 0) -> SceneSpec:
        """Six views of 48x32 pixels, for tests."""
        return cls(num_views=6, num_extras=2, width=48, height=32, num_points=300, seed=seed)


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


def _rng(spec: SceneSpec, *purpose: int) -> np.random.Generator:
    """A generator of its own for each purpose, so that one more draw here changes nothing there."""
    return np.random.default_rng([spec.seed, *purpose])


def make_cameras(spec: SceneSpec) -> tuple[list[PinholeCamera], list[PinholeCamera]]:
    """Training cameras and extras; the extras stand between training cameras."""
    half, size = np.radians(spec.arc_degrees) / 2, (spec.width, spec.height)
    train = np.linspace(-half, half, spec.num_views)
    gaps = np.linspace(1, spec.num_views - 3, spec.num_extras).round().astype(int)
    extra = (train[gaps] + train[gaps + 1]) / 2
    return arc(train, size, _rng(spec, 0)), arc(extra, size, _rng(spec, 1))


class _Crowd:
    """Places the occluders, view by view, so that most of the views that see a point show it."""

    def __init__(self, spec: SceneSpec, points: PointCloud) -> None:
        self.spec, self.points = spec, points
        seen = points.is_seen[: spec.num_views].sum(axis=0)
        self.views_left = (seen - 1) // 2
        """How many more views may hide each point."""

    def _effect(self, view: int, new: Bool[np.ndarray, "H W"]) -> Effect:
        worn_out = self.points.hidden_by(view, new) & (self.views_left <= 0)
        return Effect(float(new.mean()), worn_out.sum() / max(1, self.points.is_seen[view].sum()))

    def join(self, view: int, twin: Frame, clean: Samples, behind: Samples) -> Frame:
        """The twin of a clean picture: occluders are drawn over its samples."""
        spec, camera = self.spec, twin.camera
        chosen = occluders_for_view(
            spec.occluders,
            camera,
            view,
            lambda primitives: self._effect(view, draw(primitives, camera, 1, behind).is_new),
            _rng(spec, 2, view),
        )
        samples = draw(chosen, camera, spec.supersample, clean)
        coverage = to_pixels(samples.is_new[None].astype(np.float32), spec.supersample)[..., 0]
        self.views_left -= self.points.hidden_by(view, coverage > 0)
        image = to_uint8(to_pixels(samples.rgb, spec.supersample))
        return Frame(f"clutter_{view + 1:04d}", camera, image, twin.depth, coverage)


def make_scene(spec: SceneSpec) -> Scene:
    """Draw the capture that `spec` describes.

    Raises ConfigError where the occluders asked for cannot be placed.
    """
    things = furniture()
    world = walls_and_ground(spec.wall_height) + things
    train, extra = make_cameras(spec)
    frames: dict[str, list[Frame]] = {"clean": [], "extra": []}
    drawn: list[tuple[Samples, Samples]] = []
    for kind, cameras in (("clean", train), ("extra", extra)):
        for view, camera in enumerate(cameras):
            samples = draw(world, camera, spec.supersample, sky(camera, spec.supersample), things)
            plain = draw(world, camera, 1, sky(camera, 1))
            image, none = to_uint8(to_pixels(samples.rgb, spec.supersample)), 0 * plain.rgb[0]
            name = f"{kind}_{view + 1:04d}"
            frames[kind].append(Frame(name, camera, image, plain.depth, none))
            drawn.append((samples, plain))
    views = [(f.camera, f.image, f.depth) for f in frames["clean"] + frames["extra"]]
    points = sample_points(views, spec.num_points, _rng(spec, 3))
    crowd = _Crowd(spec, points)
    clutter = [crowd.join(i, frame, *drawn[i]) for i, frame in enumerate(frames["clean"])]
    return Scene(spec, frames["clean"], clutter, frames["extra"], points)


def _register(scene: Scene) -> list[RegisteredPhoto]:
    """Photos with their noisy observations; points hidden by occluders are not observed."""
    rng, points = _rng(scene.spec, 4), scene.points
    photos = []
    plain = enumerate(scene.clean + scene.extra)
    for view, frame in [*enumerate(scene.clutter), *plain]:
        hidden = points.hidden_by(view, frame.coverage > 0)
        ids = np.flatnonzero(points.is_seen[view] & ~hidden)
        pixels, _ = frame.camera.project(points.xyz[:, ids])
        pixels = pixels + rng.normal(scale=scene.spec.pixel_noise, size=pixels.shape)
        photos.append(RegisteredPhoto(f"{frame.name}.png", frame.camera, ids, pixels))
    return photos


def write_scene(spec: SceneSpec, folder: Path) -> Scene:
    """Make a scene and write it to `folder` as RobustNeRF names things; return its truth.

    `images/{clean,clutter,extra}_NNNN.png`, `masks/clutter_NNNN.png` (255 = occluder),
    `sparse/0/*.bin` (COLMAP) and `scene.json` (the spec).
    Raises ConfigError where `folder` already holds pictures.
    """
    if any((folder / "images").glob("*")):
        raise ConfigError(
            f"{folder / 'images'} already holds pictures and nothing was written. Remove "
            f"{folder} or name another folder."
        )
    scene = make_scene(spec)
    for frame in scene.clean + scene.clutter + scene.extra:
        write_image(folder / "images" / f"{frame.name}.png", frame.image)
    for frame in scene.clutter:
        write_image(folder / "masks" / f"{frame.name}.png", frame.mask)
    noise = _rng(spec, 5).normal(scale=spec.point_noise, size=scene.points.xyz.shape)
    write_reconstruction(
        folder / "sparse" / "0", _register(scene), scene.points.xyz + noise, scene.points.rgb
    )
    (folder / "scene.json").write_text(json.dumps(asdict(spec), indent=2) + "\n")
    return replace(scene, folder=folder)
