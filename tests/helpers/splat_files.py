"""Made-up Gaussians for files, what a camera sees of them, and readers that share no code with the
package."""

from dataclasses import replace
from unittest import mock

import gaussforge
import numpy as np
import torch

from desplat_ns.backend import projection
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.torch_tiles import TorchRasterizer
from desplat_ns.tools.export.splat_cloud import SplatCloud

IN_FRONT = (0.0, 0.0, 4.0)
"""Where they are seen by `view`, in world units."""


def cloud(seed: int = 0, count: int = 40, degree: int = 3) -> SplatCloud:
    """Gaussians of all shapes around `IN_FRONT`; values within the range of every format."""
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(count, 4))
    harmonics = rng.normal(size=(count, (degree + 1) ** 2, 3)) * 0.2
    return SplatCloud(
        means=rng.normal(size=(count, 3)) * 0.7 + IN_FRONT,
        quats=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=np.exp(rng.uniform(-3, -1, (count, 3))).astype(np.float32),
        opacities=rng.uniform(0.05, 0.95, count).astype(np.float32),
        harmonics=harmonics.astype(np.float32),
    )


def view(viewmat: np.ndarray | None = None) -> View:
    """A camera of 48 x 40 pixels at the origin that looks along +z, or one with this pose."""
    pose = np.eye(4) if viewmat is None else viewmat
    intrinsics = torch.tensor([[40.0, 0, 24], [0, 40, 20], [0, 0, 1]], dtype=torch.float64)
    return View(torch.from_numpy(pose).double(), intrinsics, 48, 40)


def drawn(cloud: SplatCloud, view: View, background: tuple[float, ...] = (0, 0, 0)) -> np.ndarray:
    """The picture [H, W, 3] over a colour, in float64."""
    splats = Splats(
        *(
            torch.from_numpy(values.astype(np.float64))
            for values in (cloud.means, cloud.quats, cloud.scales, cloud.opacities, cloud.harmonics)
        ),
        sh_degree=cloud.degree,
    )
    view = replace(view, viewmat=view.viewmat.double(), K=view.K.double())
    with mock.patch.object(projection, "NEAR_PLANE", 1e-6):
        drawn = TorchRasterizer()(splats, view, RenderSettings(antialiased=cloud.antialiased))
    return (drawn.rgb + (1 - drawn.alpha) * torch.tensor(background).double()).numpy()


def read_splats(content: bytes, kind: str = "spz") -> SplatCloud:
    """By gaussforge, a program in C++, for SPZ around the format's reference implementation."""
    data = gaussforge.GaussForge().read(content, kind)["data"]

    def array(name: str, *shape: int) -> np.ndarray:
        return np.frombuffer(data[name], np.float32).reshape(data["numPoints"], *shape)

    return SplatCloud(
        means=array("positions", 3).astype(np.float64),
        quats=array("rotations", 4),
        scales=np.exp(array("scales", 3)),
        opacities=1 / (1 + np.exp(-array("alphas"))),
        harmonics=np.concatenate([array("colors", 1, 3), array("sh", -1, 3)], axis=1),
    )
