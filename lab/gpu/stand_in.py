"""nerfstudio's Splatfacto without a GPU: this package's rasterizer where it calls gsplat's.

For rehearsals and tests. On a GPU Splatfacto draws as nerfstudio has it, through nothing of ours.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import torch
from nerfstudio.models import splatfacto
from torch import Tensor

from desplat_ns.backend import resolve
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.gaussians.densification import strategy_info


def rasterization(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    render_mode: str = "RGB",
    sh_degree: int | None = None,
    absgrad: bool = False,
    rasterize_mode: str = "classic",
    **_: Any,
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    """As gsplat's, for one camera on the CPU: image [1, H, W, C], alpha [1, H, W, 1], and what
    gsplat's strategies read."""
    settings = RenderSettings(
        antialiased=rasterize_mode == "antialiased", depth="ED" in render_mode, absgrad=absgrad
    )
    splats = Splats(means, quats, scales, opacities, colors, sh_degree=sh_degree)
    view = View(viewmats[0], Ks[0], width, height)
    drawn = resolve("numba", "cpu")(splats, view, settings)
    image = drawn.rgb if drawn.depth is None else torch.cat([drawn.rgb, drawn.depth], dim=-1)
    return image[None], drawn.alpha[None], strategy_info(drawn, view)


@contextmanager
def splatfacto_on(device: str) -> Iterator[None]:
    """Within, nerfstudio's Splatfacto can be built, trained and drawn on a device; on "cuda" it is
    left as it is, with the package's kernels of gsplat."""
    if device != "cpu":
        resolve("gsplat", device)  # before Splatfacto calls gsplat, which would compile its own
        yield
        return
    with (
        mock.patch.object(splatfacto, "rasterization", rasterization),
        mock.patch.object(Tensor, "cuda", lambda self, *_, **__: self),
    ):
        yield
