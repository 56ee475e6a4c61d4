from __future__ import annotations

import inspect

import gsplat.rendering
import pytest
import torch
from nerfstudio.models import splatfacto

from desplat_ns.backend import RenderSettings, resolve
from lab.gpu import stand_in
from lab.gpu.stand_in import rasterization, splatfacto_on
from tests.backend.scenes import random_scene


def test_it_takes_its_arguments_under_gsplats_names():
    known = inspect.signature(gsplat.rendering.rasterization).parameters
    own = inspect.signature(rasterization).parameters
    assert {name for name, p in own.items() if p.kind != p.VAR_KEYWORD} <= known.keys()


@pytest.mark.parametrize("depth", [False, True])
def test_it_gives_what_the_backend_draws_as_gsplat_would(depth):
    scene = random_scene(1, count=12, size=(20, 14), sh_degree=1).to(torch.float32)
    splats = scene.splats
    image, alpha, info = rasterization(
        **{name: getattr(splats, name) for name in ("means", "quats", "scales", "opacities")},
        **{"colors": splats.colors, "sh_degree": 1, "width": 20, "height": 14},
        **{"viewmats": scene.view.viewmat[None], "Ks": scene.view.K[None], "packed": False},
        render_mode="RGB+ED" if depth else "RGB",
    )
    want = resolve("numba", "cpu")(splats, scene.view, RenderSettings(depth=depth))
    assert image.shape == (1, 14, 20, 3 + depth) and torch.equal(image[0, ..., :3], want.rgb)
    assert torch.equal(alpha[0], want.alpha) and info["radii"].shape[:2] == (1, 12)
    assert want.depth is None or torch.equal(image[0, ..., 3:], want.depth)


def drawing_with() -> object:
    return getattr(splatfacto, "rasterization")  # noqa: B009 - imported there, not exported


def test_on_a_gpu_splatfacto_is_left_as_it_is_with_kernels_that_are_there_before(monkeypatch):
    upstream, resolved = drawing_with(), []
    monkeypatch.setattr(stand_in, "resolve", lambda *what: resolved.append(what))
    with splatfacto_on("cuda"):
        assert drawing_with() is upstream and resolved == [("gsplat", "cuda")]
    with splatfacto_on("cpu"):
        assert drawing_with() is rasterization
    assert drawing_with() is upstream
