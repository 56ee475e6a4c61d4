"""The catalogue: scenes that are hard on arithmetic.

What must be culled is not drawn, has a gradient of exactly 0 and leaves the others as if alone.
Everything else is right within the bounds that docs/dev/stability.md derives. Every scene holds a
second Gaussian, a witness behind the hard one, so that what a hard Gaussian does to others shows.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch

from desplat_ns.backend import RenderSettings
from tests.backend.scenes import TestScene, camera, joined, picked, random_scene

CLASSIC = RenderSettings(depth=True, absgrad=True)
ANTIALIASED = RenderSettings(depth=True, absgrad=True, antialiased=True)


@dataclass(frozen=True)
class Case:
    """One hard scene."""

    name: str
    make: Callable[[], TestScene]
    culled: tuple[int, ...] = ()
    """Gaussians that must not be drawn."""
    settings: RenderSettings = CLASSIC
    exact_in_float32: bool = True
    """False: float32 cannot hold the scene, or its bound is above 1; there it is only finite."""

    @property
    def drawn(self) -> TestScene:
        """The scene without what must be culled, in float64."""
        scene = self.make()
        keep = [i for i in range(len(scene.means)) if i not in self.culled]
        return picked(scene, keep).to(torch.float64)


def hard(**changes) -> TestScene:
    """A Gaussian of about a pixel, off every symmetry, before a camera of 5 x 5 pixels."""
    values = {
        "means": torch.tensor([[0.03, -0.05, 2.0]]),
        "quats": torch.tensor([[0.9, 0.2, -0.3, 0.1]]),
        "scales": torch.tensor([[0.2, 0.1, 0.15]]),
        "opacities": torch.tensor([0.6]),
        "colors": torch.tensor([[0.9, 0.4, 0.2]]),
        "viewmat": torch.eye(4),
        "K": torch.tensor([[16.0, 0.0, 2.4], [0.0, 17.0, 2.6], [0.0, 0.0, 1.0]]),
        "size": (5, 5),
    }
    given = {k: torch.tensor(v) if isinstance(v, list) else v for k, v in changes.items()}
    return TestScene(**{**values, **given})


def witness(depth: float = 3.0) -> TestScene:
    """An ordinary Gaussian at some depth, with another shape and colour."""
    return hard(
        means=[[-0.02 * depth, 0.03 * depth, depth]],
        quats=[[0.5, -0.4, 0.1, 0.7]],
        scales=[[0.12 * depth, 0.08 * depth, 0.1 * depth]],
        opacities=[0.5],
        colors=[[0.1, 0.6, 0.8]],
    )


def right(name: str, *, settings: RenderSettings = CLASSIC, **changes) -> Case:
    """An extreme but valid Gaussian before the witness."""
    return Case(name, lambda: joined(hard(**changes), witness()), settings=settings)


def broken(name: str, **changes) -> Case:
    """A degenerate Gaussian before the witness."""
    return Case(name, lambda: joined(hard(**changes), witness()), culled=(0,))


def turned(angle: float, axis: tuple[float, float, float]) -> list[list[float]]:
    """A quaternion."""
    return [[math.cos(angle / 2), *(math.sin(angle / 2) * a for a in axis)]]


def stack(count: int, opacity: tuple[float, float], seed: int = 0) -> TestScene:
    """Layers wider than the image, one behind the other."""
    rng = torch.Generator().manual_seed(seed)
    low, high = opacity
    return hard(
        means=torch.cat([torch.zeros(count, 2), 2 + torch.rand(count, 1, generator=rng)], dim=-1),
        quats=torch.randn(count, 4, generator=rng),
        scales=3 + torch.rand(count, 3, generator=rng),
        opacities=low + (high - low) * torch.rand(count, generator=rng),
        colors=torch.rand(count, 3, generator=rng),
    )


def same_depth() -> TestScene:
    layers = stack(6, (0.2, 0.5), seed=3)
    layers.means[:, 2] = 2.0
    return layers


def moved(scene: TestScene, offset: tuple[float, float, float], dtype: torch.dtype) -> TestScene:
    """Scene and camera at another place, in `dtype` arithmetic."""
    shift = torch.tensor(offset, dtype=dtype)
    viewmat = scene.viewmat.to(dtype).clone()
    viewmat[:3, 3] -= viewmat[:3, :3] @ shift
    return replace(scene, means=scene.means.to(dtype) + shift, viewmat=viewmat)


def turned_away(scene: TestScene) -> TestScene:
    """The same seen by a camera off the axes, so that no sum of coordinates is exact by chance."""
    R = camera(5, 5)[0][:3, :3].to(scene.means.dtype)
    viewmat = scene.viewmat.clone()
    viewmat[:3, :3] = R
    return replace(scene, means=scene.means @ R, viewmat=viewmat)


def geo_referenced() -> TestScene:
    """A millimetre's detail a million metres from the origin, in float64."""
    small = joined(hard(scales=[[2e-3, 1e-3, 1.5e-3]]), witness())
    small.means[:, :2] *= 0.01
    small = small.to(torch.float64)
    small.K = torch.tensor([[1600.0, 0, 2.4], [0, 1700.0, 2.6], [0, 0, 1]]).double()
    small.viewmat = small.viewmat.double()
    return moved(turned_away(small), (1.2e6, -3.4e6, 250.0), torch.float64)


def a_thousand_metres_out() -> TestScene:
    """Detail of half a metre a thousand metres from the origin, in float32."""
    scene = joined(hard(scales=[[0.5, 0.25, 0.4]], means=[[0.1, -0.2, 8.0]]), witness(12.0))
    return moved(turned_away(scene), (1000.0, -2000.0, 500.0), torch.float32)


def long_needle() -> TestScene:
    """It points at the middle of the image, across the diagonal."""
    needle = hard(
        means=[[265.0, 265.0, 2.0]], scales=[[400.0, 1e-6, 1e-6]],
        quats=turned(math.pi / 4, (0.0, 0.0, 1.0)),
    )  # fmt: skip
    return joined(needle, witness())


def off_axis() -> TestScene:
    """Both Gaussians stand where a principal point far out puts the image."""
    both = joined(hard(), witness())
    both.K = torch.tensor([[16.0, 0, -30.0], [0, 17.0, 60.0], [0, 0, 1]])
    both.means[:, 0] += both.means[:, 2] * 32 / 16
    both.means[:, 1] -= both.means[:, 2] * 57 / 17
    return both


def with_sh(scale: float, degree: int = 1) -> TestScene:
    rng = torch.Generator().manual_seed(5)
    values = scale * (torch.rand(2, (degree + 1) ** 2, 3, generator=rng) - 0.5)
    both = joined(hard(), witness())
    return replace(both, colors=values, sh_degree=degree)


def row_of_pixels(width: int, height: int) -> TestScene:
    """Gaussians spread over an image of one pixel's width or height."""
    length = max(width, height)
    scene = random_scene(41, count=12, size=(width, height))
    K = torch.tensor([[0.9 * length, 0, width / 2], [0, 0.9 * length, height / 2], [0, 0, 1]])
    rng = torch.Generator().manual_seed(7)
    z = 2 + torch.rand(12, 1, generator=rng)
    reach = torch.tensor([width, height]) / length
    place = (torch.rand(12, 2, generator=rng) - 0.5) * reach * z
    return replace(
        scene, means=torch.cat([place, z], -1), viewmat=torch.eye(4), K=K,
        scales=0.002 + 0.05 * torch.rand(12, 3, generator=rng),
    )  # fmt: skip


def opaque_before_two() -> TestScene:
    """Alpha is at the clamp over the whole image: what is behind has a thousandth left."""
    front = hard(scales=[[40.0, 50.0, 60.0]], opacities=[1.0])
    return joined(joined(front, witness()), witness(4.0))


def two_opaque_before_one() -> TestScene:
    """A thousandth of a thousandth is below the stop: the second is not drawn, nor the third."""
    front = hard(scales=[[40.0, 50.0, 60.0]], opacities=[1.0])
    second = hard(scales=[[40.0, 50.0, 60.0]], opacities=[1.0], means=[[0.0, 0.0, 2.5]])
    return joined(joined(front, second), witness())


NEEDLE = turned(0.7, (0.0, 0.0, 1.0))

CASES: tuple[Case, ...] = (
    # Where the camera stands
    right("the camera inside a Gaussian", means=[[0.05, -0.03, 0.3]], scales=[[5.0, 4.0, 6.0]]),
    right("the camera inside, centre just beyond the near plane",
          means=[[1e-4, -2e-4, 0.011]], scales=[[2.0, 1.0, 1.5]]),
    broken("the mean in the camera's centre", means=[[0.0, 0.0, 0.0]]),
    broken("z = 1e-20", means=[[0.0, 0.0, 1e-20]]),
    broken("z just before the near plane", means=[[0.0, 0.0, 0.0099999]], scales=[[1e-3] * 3]),
    right("z just behind the near plane",
          means=[[1e-5, 2e-5, 0.0100001]], scales=[[1e-3, 2e-3, 1.5e-3]]),
    broken("behind the camera", means=[[0.1, 0.1, -2.0]]),
    right("z = 9e9, just before the far plane",
          means=[[1e8, -2e8, 9e9]], scales=[[1e9, 2e9, 1.5e9]]),
    broken("beyond the far plane", means=[[0.0, 0.0, 1.1e10]], scales=[[1e9] * 3]),
    right("beyond the border, where the Jacobian's slope is held",
          means=[[1.2, -0.9, 2.0]], scales=[[0.8, 0.6, 0.7]]),
    # Rotations
    broken("a zero quaternion", quats=[[0.0, 0.0, 0.0, 0.0]]),
    broken("a quaternion of length 1e-13", quats=[[1e-13, 0.0, 0.0, 0.0]]),
    right("a quaternion of length 1e-11", quats=[[9e-12, 2e-12, -3e-12, 1e-12]]),
    right("a quaternion of length 1e18", quats=[[9e17, 2e17, -3e17, 1e17]]),
    # Sizes
    *(right(f"log-scales of {p}", scales=[[math.exp(p)] * 3]) for p in (-40, 5, 15)),
    broken("log-scales of 20", scales=[[math.exp(20)] * 3]),
    *(
        broken(f"a needle of 4e9 pixels, along its axis {k}",
               scales=[[5e8 if k == axis else 0.1 for axis in range(3)]])
        for k in range(3)
    ),
    right("scales of 0", scales=[[0.0, 0.0, 0.0]]),
    right("a needle, 1e6 : 1", scales=[[1.0, 1e-6, 1e-6]], quats=NEEDLE),
    right("a needle, 1e9 : 1, 400 pixels long (det <= 0 in float32)",
          scales=[[50.0, 5e-8, 5e-8]], quats=NEEDLE),
    Case("a needle whose centre lies 3,000 pixels beside the image", long_needle,
         exact_in_float32=False),
    right("a needle that points at the camera",
          scales=[[1e-6, 1e-6, 1.0]], quats=[[1.0, 0.0, 0.0, 0.0]]),
    right("a pancake, 1e6 : 1, face on", scales=[[1.0, 1.0, 1e-6]], quats=[[1.0, 0.02, 0.01, 0.0]]),
    right("a pancake edge on", scales=[[1.0, 0.8, 1e-6]], quats=turned(1.55, (0.8, 0.6, 0.0))),
    # Antialiasing
    right("antialiased: scales of 0", settings=ANTIALIASED, scales=[[0.0, 0.0, 0.0]]),
    right("antialiased: a needle", settings=ANTIALIASED, scales=[[1.0, 0.02, 0.02]], quats=NEEDLE),
    right("antialiased: a pancake edge on", settings=ANTIALIASED,
          scales=[[1.0, 0.8, 0.02]], quats=turned(1.5, (0.8, 0.6, 0.0))),
    # Opacities and layers
    right("opacity exactly 0", opacities=[0.0]),
    right("opacity exactly 1/255", opacities=[1 / 255], scales=[[40.0, 50.0, 60.0]]),
    right("opacity just below the clamp", opacities=[0.9985], scales=[[40.0, 50.0, 60.0]]),
    right("opacity exactly 1", opacities=[1.0]),
    Case("alpha at the clamp before what wants a gradient", opaque_before_two),
    Case("two at the clamp: blending stops", two_opaque_before_one),
    Case("300 opaque layers", lambda: stack(300, (0.9, 1.0))),
    Case("1,000 faint layers", lambda: stack(1000, (0.005, 0.008))),
    Case("equal depths", same_depth),
    # Cameras and places
    Case("1e6 from the origin with detail of 1e-3 (geo-referenced)", geo_referenced,
         exact_in_float32=False),
    Case("1,000 from the origin with detail of 0.5", a_thousand_metres_out),
    right("a focal length of 1 pixel", K=[[1.0, 0, 2.4], [0, 1.1, 2.6], [0, 0, 1]],
          scales=[[2.0, 3.0, 2.5]]),
    right("a focal length of 1e5 pixels", K=[[1e5, 0, 2.4], [0, 1.1e5, 2.6], [0, 0, 1]],
          means=[[3e-6, -7e-6, 2.0]], scales=[[3e-5, 2e-5, 2.5e-5]]),
    Case("a principal point outside the image", off_axis),
    right("an image of 1 x 1", size=(1, 1), means=[[-0.2, -0.2, 2.0]]),
    Case("an image of 2000 x 1", lambda: row_of_pixels(2000, 1)),
    Case("an image of 1 x 2000", lambda: row_of_pixels(1, 2000)),
    Case("no Gaussian visible", lambda: hard(means=[[0.0, 0.0, -2.0]]), culled=(0,)),
    Case("no Gaussians", lambda: picked(hard(), [])),
    # Colours
    Case("SH coefficients of 1e15", lambda: with_sh(1e15)),
    right("colours beyond [0, 1]", colors=[[50.0, -3.0, 1e4]]),
)  # fmt: skip
"""All of the catalogue."""
