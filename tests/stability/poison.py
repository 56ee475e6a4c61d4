"""Poisoned inputs through a rasterizer's public entry, and what may become of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from desplat_ns.backend import RenderSettings
from tests.backend.scenes import PARAMETERS, Backend, TestScene
from tests.stability.cases import hard, joined, witness
from tests.stability.measure import features

POISON = (
    math.nan, math.inf, -math.inf, 0.0, -0.0, 1e-45, -1e-45, 1.2e-38, 1e-30, 1e-20, 1e-12, 1e-6,
    1 / 255, 0.999, 1.0, -1.0, 1e-4, 0.01, 1e4, 1e8, 1e10, 1e18, 1.9e19, 1e38, -1e38, 3.4e38,
)  # fmt: skip
"""Not numbers, infinities, zeros, denormals, the exact thresholds, powers that overflow."""

PLACES = {"means": 3, "quats": 4, "scales": 3, "opacities": 1, "colors": 3}
CAMERA = ("viewmat", "K")


@dataclass(frozen=True)
class Dose:
    """One value put somewhere."""

    into: str
    """A parameter, "viewmat" or "K"."""
    gaussian: int
    component: int
    value: float


def healthy(sh_degree: int | None) -> TestScene:
    """Four ordinary Gaussians one behind the other; 3 x 3 colour coefficients with SH."""
    scene = joined(joined(hard(), witness(2.5)), joined(witness(), witness(4.0)))
    if sh_degree is None:
        return scene
    rng = torch.Generator().manual_seed(1)
    return replace(scene, colors=torch.rand(4, 4, 3, generator=rng) - 0.3, sh_degree=sh_degree)


def poisoned(scene: TestScene, doses: list[Dose]) -> TestScene:
    """The scene with all doses in it."""
    changed = {n: getattr(scene, n).clone() for n in (*PARAMETERS, *CAMERA)}
    for dose in doses:
        if dose.into in CAMERA:
            matrix = changed[dose.into]
            matrix.view(-1)[dose.component % matrix.numel()] = dose.value
        else:
            row = changed[dose.into][dose.gaussian].view(-1)
            row[dose.component % len(row)] = dose.value
    return replace(scene, **changed)


@dataclass(frozen=True)
class Fate:
    """What became of one poisoned scene."""

    refused: str = ""
    """Why it was not drawn at all: the ValueError's text."""
    culled: int = 0
    faults: tuple[str, ...] = ()
    """What must never happen; empty if all is well."""


def give(backend: Backend, doses: list[Dose], sh_degree: int | None, antialiased: bool) -> Fate:
    """Render a poisoned scene forwards and backwards, and look for what must never happen."""
    scene = poisoned(healthy(sh_degree), doses)
    settings = RenderSettings(depth=True, absgrad=True, antialiased=antialiased)
    try:
        leaves, got = backend.render(scene, settings)
    except ValueError as error:
        return Fate(refused=str(error))
    image = features(got)
    image.sum().backward()
    culled = (got.radii == 0).cpu()
    gradients = {name: getattr(leaves, name).grad for name in PARAMETERS}
    faults = []
    if not image.isfinite().all():
        faults.append("the image is not finite")
    for name, gradient in gradients.items():
        if not gradient.isfinite().all():
            faults.append(f"the gradient by {name} is not finite")
        if gradient[culled].abs().sum() != 0:
            faults.append(f"the gradient by {name} of what is culled is not 0")
    if not all(finite_rows(scene, i) for i in (~culled).nonzero()[:, 0].tolist()):
        faults.append("something that is not finite was drawn")
    if not torch.equal(image.detach(), without(backend, scene, culled, settings)):
        faults.append("what is culled changes the image")
    return Fate(culled=int(culled.sum()), faults=tuple(faults))


def finite_rows(scene: TestScene, i: int) -> bool:
    return all(bool(getattr(scene, name)[i].isfinite().all()) for name in PARAMETERS)


def without(backend: Backend, scene: TestScene, culled: Tensor, settings: RenderSettings) -> Tensor:
    """The image of the scene from which the culled Gaussians were taken away beforehand."""
    kept = {name: getattr(scene, name)[~culled] for name in PARAMETERS}
    return features(backend.render(replace(scene, **kept), settings)[1]).detach()
