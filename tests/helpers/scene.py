"""A made-up scene, as its page shows it."""

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from desplat_ns.backend.protocol import View
from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.core.pages import Picture
from desplat_ns.tools.export.splat_cloud import SplatCloud
from desplat_ns.tools.scene.gather import Light, PageCamera, PageScene
from tests.helpers import splat_files

WIDTH, HEIGHT = 200, 150
BACKGROUND = (0.2, 0.4, 0.1)
PHOTO = (250, 240, 20)
"""The colour of all photos, which nothing in the scene has."""


def cloud(seed: int = 0, count: int = 300, degree: int = 2) -> SplatCloud:
    """Gaussians of all shapes within about one unit of the origin, a little view-dependent."""
    made = splat_files.cloud(seed, count, degree)
    harmonics = made.harmonics * 0.4
    harmonics[:, 0] *= 10
    means = (made.means - splat_files.IN_FRONT) * 0.7
    return replace(made, means=means, scales=made.scales * np.float32(0.5), harmonics=harmonics)


def red_disc() -> SplatCloud:
    """What was taken out of a photo: a red disc near the camera that looks from `view(0)`."""
    count = 4
    red = (np.array([1.0, 0.0, 0.0]) - 0.5) / C0
    return SplatCloud(
        means=np.tile([0.0, -2.4, 0.5], (count, 1)),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.full((count, 3), 0.06, np.float32),
        opacities=np.full(count, 0.9, np.float32),
        harmonics=np.tile(red.astype(np.float32), (count, 1, 1)),
    )


def view(degrees: float) -> View:
    """A camera 3 units from the origin, so many degrees around the vertical from -y, that looks at
    it from a little above; its lens is neither centred nor square."""
    angle = np.radians(degrees)
    place = np.array([3 * np.sin(angle), -3 * np.cos(angle), 0.6])
    forward = -place / np.linalg.norm(place)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, -np.cross(right, forward), forward])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ place
    intrinsics = torch.tensor([[210.0, 0, 95], [0, 190, 82], [0, 0, 1]], dtype=torch.float64)
    return View(torch.from_numpy(pose), intrinsics, WIDTH, HEIGHT)


def camera(name: str, degrees: float, **changes: Any) -> PageCamera:
    """A photo's camera; the photo has one colour."""
    photo = np.full((HEIGHT, WIDTH, 3), PHOTO, np.uint8)
    made_up = PageCamera(name, False, view(degrees), near=0.01, reach=3.0, photo=Picture(photo))
    return replace(made_up, **changes)


def light(name: str, brighter: float = 0.2, of: SplatCloud | None = None) -> Light:
    """A light in which a scene is brighter by so much, and the more so the more it was."""
    harmonics = (cloud() if of is None else of).harmonics * (1 + brighter)
    harmonics[:, 0] += brighter / C0
    return Light(name, (0.1, 0.2, 0.7), harmonics.astype(np.float32))


def contents(**changes: Any) -> PageScene:
    """A page's contents: two training photos, one with a distractor, and one held out."""
    grey = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    made_up = PageScene(
        title="yard",
        date="2026-01-31",
        cloud=cloud(),
        weigh=lambda splats: np.arange(len(splats), dtype=np.float64),
        background=BACKGROUND,
        light="",
        cameras=[
            camera("a.png", 0, distractors=red_disc()),
            camera("b.png", 40),
            camera("extra.png", -70, held_out=True),
        ],
        pictures=[("a.png", Picture(grey))],
    )
    return replace(made_up, **changes)


def drawn(
    cloud: SplatCloud, view: View, background: tuple[float, float, float] = BACKGROUND
) -> np.ndarray:
    """Our own picture of it [H, W, 3], over a colour, in [0, 1]."""
    return splat_files.drawn(cloud, view, background).clip(0, 1)


def psnr(image: np.ndarray, other: np.ndarray) -> float:
    """dB, of images in [0, 1]."""
    return float(-10 * np.log10(np.mean((image - other) ** 2)))
