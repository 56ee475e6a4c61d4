"""Scenes for the contract suite, the tolerances that they allow, and ways to render them."""

from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch
from torch import Tensor

from desplat_ns.backend import Rendering, RenderSettings, Splats, View, resolve
from desplat_ns.backend.registry import unavailable_reason
from tests.backend import reference

PARAMETERS = ("means", "quats", "scales", "opacities", "colors")


@dataclass
class TestScene:
    """Gaussians and a camera. Values are float32 numbers whatever the dtype that holds them."""

    __test__ = False

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    colors: Tensor
    viewmat: Tensor
    K: Tensor
    size: tuple[int, int]
    sh_degree: int | None = None

    def to(self, dtype: torch.dtype, device: str = "cpu") -> "TestScene":
        """A copy whose parameters are leaves that require gradients."""
        copies = {
            name: getattr(self, name).detach().to(device, dtype).requires_grad_()
            for name in PARAMETERS
        }
        viewmat, K = self.viewmat.to(device, dtype), self.K.to(device, dtype)
        return TestScene(**copies, viewmat=viewmat, K=K, size=self.size, sh_degree=self.sh_degree)

    @property
    def parameters(self) -> list[Tensor]:
        return [getattr(self, name) for name in PARAMETERS]

    @property
    def splats(self) -> Splats:
        return Splats(*self.parameters, sh_degree=self.sh_degree)

    @property
    def view(self) -> View:
        return View(self.viewmat, self.K, *self.size)


def camera(width: int, height: int) -> tuple[Tensor, Tensor]:
    """A camera turned and moved off the axes, off-centre, with unequal focal lengths."""
    axis = torch.tensor([0.2, -0.9, 0.3], dtype=torch.float64)
    turn = torch.linalg.matrix_exp(0.4 * torch.linalg.cross(torch.eye(3).double(), -axis[None]))
    viewmat = torch.eye(4, dtype=torch.float64)
    viewmat[:3, :3], viewmat[:3, 3] = turn, torch.tensor([0.3, -0.2, 0.5])
    K = torch.eye(3, dtype=torch.float64)
    K[0, 0], K[1, 1], K[0, 2], K[1, 2] = 0.9 * width, 1.1 * width, 0.47 * width, 0.55 * height
    return viewmat.float(), K.float()


def random_scene(
    seed: int,
    count: int = 40,
    size: tuple[int, int] = (37, 21),
    opacity: tuple[float, float] = (0.05, 0.35),
    sh_degree: int | None = None,
) -> TestScene:
    """Gaussians of 1 to 6 pixels all over the image and a little beyond its border.

    Opacities up to 0.35 are below the cutoff outside 3 sigma, where gsplat stops to look.
    """
    rng = torch.Generator().manual_seed(seed)

    def uniform(*shape: int, low: float = 0.0, high: float = 1.0) -> Tensor:
        return low + (high - low) * torch.rand(*shape, generator=rng, dtype=torch.float64)

    viewmat, K = camera(*size)
    z = uniform(count, low=1.0, high=5.0)
    pixel = uniform(count, 2, low=-0.1, high=1.1) * torch.tensor(size, dtype=torch.float64)
    rays = (
        torch.cat([pixel, torch.ones(count, 1).double()], dim=-1) @ torch.linalg.inv(K.double()).T
    )
    means_c = rays * z[:, None]
    means = (means_c - viewmat[:3, 3].double()) @ viewmat[:3, :3].double()
    scales = uniform(count, 3, low=0.5, high=5.0) * (z / K[0, 0].double())[:, None]
    if sh_degree is None:
        colors = uniform(count, 3)
    else:
        colors = uniform(count, (sh_degree + 1) ** 2, 3, low=-0.4, high=0.4)
    return TestScene(
        means.float(),
        torch.randn(count, 4, generator=rng) * 2,
        scales.float(),
        uniform(count, low=opacity[0], high=opacity[1]).float(),
        colors.float(),
        viewmat,
        K,
        size,
        sh_degree,
    )


def one_gaussian(**changes) -> TestScene:
    """A round Gaussian, 1 pixel wide, in the centre of the middle pixel of a 9 x 9 image."""
    values = {
        "means": torch.tensor([[0.0, 0.0, 2.0]]),
        "quats": torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        "scales": torch.full((1, 3), 0.125),
        "opacities": torch.tensor([0.5]),
        "colors": torch.tensor([[1.0, 0.5, 0.25]]),
        "viewmat": torch.eye(4),
        "K": torch.tensor([[16.0, 0.0, 4.5], [0.0, 16.0, 4.5], [0.0, 0.0, 1.0]]),
        "size": (9, 9),
    }
    return TestScene(**{**values, **changes})


def joined(a: TestScene, b: TestScene) -> TestScene:
    """The Gaussians of both, seen by the camera of `a`."""
    both = {name: torch.cat([getattr(a, name), getattr(b, name)]) for name in PARAMETERS}
    return TestScene(**both, viewmat=a.viewmat, K=a.K, size=a.size, sh_degree=a.sh_degree)


def picked(scene: TestScene, rows: Tensor | list[int]) -> TestScene:
    """Some of a scene's Gaussians, in this order."""
    return replace(scene, **{name: getattr(scene, name)[rows] for name in PARAMETERS})


def render_reference(scene: TestScene, settings: RenderSettings) -> reference.Reference:
    """Render a float64 scene with the independent reference."""
    return reference.composite(reference.project(scene, settings.antialiased), scene.size)


def tolerance(dtype: torch.dtype, size: tuple[int, int], sharpness: float) -> float:
    """Relative error that a pixel's alpha may have, from rounding alone.

    A mean is the sum and quotient of about 8 rounded terms as large as the image, so it is off by
    8 eps W pixels; log(alpha) changes by sqrt(2 sigma) <= sqrt(2 ln 255) < 3.4 times the square
    root of the conic's largest eigenvalue for each pixel. The other errors, of a few eps, are less
    than that of a mean. Weights sum to 1, so this bounds colour and alpha too.
    """
    return 8 * torch.finfo(dtype).eps * max(*size, 16) * 3.4 * sharpness


@dataclass
class Backend:
    """A rasterizer, where it draws, and in which dtype."""

    name: str
    device: str
    dtype: torch.dtype

    def render(self, scene: TestScene, settings: RenderSettings) -> tuple[TestScene, Rendering]:
        """Render; also the scene's leaves, whose gradients the caller asks for."""
        leaves = scene.to(self.dtype, self.device)
        rendering = resolve(self.name, self.device)(leaves.splats, leaves.view, settings)  # pyright: ignore[reportArgumentType]
        if rendering.means2d.requires_grad:
            rendering.means2d.retain_grad()
        return leaves, rendering


BACKENDS = [
    pytest.param(("torch", "cpu", torch.float32), id="torch-float32"),
    pytest.param(("torch", "cpu", torch.float64), id="torch-float64"),
    pytest.param(("numba", "cpu", torch.float32), id="numba"),
    pytest.param(("torch", "cuda", torch.float32), id="torch-cuda", marks=pytest.mark.gpu),
    pytest.param(("gsplat", "cuda", torch.float32), id="gsplat", marks=pytest.mark.gpu),
]

EXACT_BACKENDS: list[Any] = [backend for backend in BACKENDS if backend.id != "gsplat"]
"""gsplat cuts opaque Gaussians off at 3 sigma, by design."""


def make_backend(name: str, device: str, dtype: torch.dtype) -> Backend:
    """The backend, or a skip that says why it cannot run here."""
    reason = unavailable_reason(name, device)
    if reason is not None:
        pytest.skip(f"backend '{name}' {reason}")
    return Backend(name, device, dtype)
