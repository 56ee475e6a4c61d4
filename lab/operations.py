"""Operations that torch dispatches in a training step, by the place that asks for them.

Where there are few Gaussians a step on a GPU takes as long as the launches of its kernels, of which
an operation has about one. They are counted on any machine: `as_on_cuda` lets CPU tensors go the
way of CUDA ones, with stand-ins for gsplat's kernels, whose own operations are left out.
"""

import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import gsplat
import gsplat.rendering
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from desplat_ns.backend import projection, resolve
from desplat_ns.backend.protocol import RenderSettings, Splats, View

FREE = re.compile(r"aten::(detach|alias|_unsafe_view|lift_fresh|scalar_tensor|(new_)?empty.*)$")
"""What launches nothing, beside views."""

PLACE = re.compile(r'(desplat_ns|lab)/([\w/]+\.py)(?:", line \d+, in |:)(\w+)')
KERNELS = re.compile(r"operations\.py|backend/numba")
"""Files that stand in for gsplat's kernels."""


def operations_of(step: Callable[[], object]) -> Counter[str]:
    """Numbers of operations by "file:function" of the package, the innermost that asked for them;
    "-" is everything else. The backward pass counts where the forward pass was."""
    counted = _Counted()
    with torch.autograd.set_detect_anomaly(True, check_nan=False), counted:
        step()
    return counted.places


def table_of(places: Counter[str], most: int = 12) -> str:
    """Their sum and the places with most, a line each."""
    lines = [f"{number:5}  {place}" for place, number in places.most_common(most)]
    return "\n".join([f"{places.total():5}  operations, of these", *lines])


class _Counted(TorchDispatchMode):
    def __init__(self) -> None:
        super().__init__()
        self.places = Counter[str]()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        place = None if func.is_view or FREE.match(func._schema.name) else _place()
        if place is not None:
            self.places[place] += 1
        return func(*args, **(kwargs or {}))


def _place() -> str | None:
    """Of the operation at hand; None within stand-ins."""
    node: Any = torch._C._current_autograd_node()
    stack: list[str] = [] if node is None else node.metadata.get("traceback_", [])
    frame = sys._getframe(2)
    while node is None and frame is not None:
        stack.insert(0, f"{frame.f_code.co_filename}:{frame.f_code.co_name}")
        frame = frame.f_back
    found = [match for match in map(PLACE.search, stack) if match is not None]
    if any(KERNELS.search(match[2]) and match[3] != "operations_of" for match in found):
        return None
    ours = [f"{match[2]}:{match[3]}" for match in found if match[1] == "desplat_ns"]
    return ours[-1] if ours else "-"


@contextmanager
def as_on_cuda() -> Iterator[None]:
    """Within, tensors on the CPU say that they are on CUDA, and the `numba` backend draws where
    gsplat is called."""
    with (
        mock.patch.object(Tensor, "is_cpu", False),
        mock.patch.object(Tensor, "is_cuda", True),
        mock.patch.object(projection, "unavailable_reason", lambda: None),
        mock.patch.object(gsplat, "spherical_harmonics", _spherical_harmonics),
        mock.patch.object(gsplat.rendering, "rasterization", rasterization),
    ):
        yield


def _spherical_harmonics(degree: int, dirs: Tensor, coefficients: Tensor, masks: Tensor) -> Tensor:
    """As gsplat's."""
    from desplat_ns.backend.numba_kernels.sh import EvaluateColors

    shown, center = masks.int(), torch.zeros(3)
    colors = EvaluateColors.apply(dirs, coefficients, shown, center, degree, False)
    return colors[0] - 0.5  # type: ignore[index]


def rasterization(
    *, means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, colors: Tensor,
    viewmats: Tensor, Ks: Tensor, width: int, height: int, render_mode: str,
    absgrad: bool, rasterize_mode: str, sh_degree: int | None = None, **_: Any,
) -> tuple[Tensor, Tensor, dict[str, Any]]:  # fmt: skip
    """As gsplat's for one camera: image [1, H, W, C], alpha [1, H, W, 1], and what gsplat's
    strategies read."""
    settings = RenderSettings(rasterize_mode == "antialiased", "ED" in render_mode, absgrad)
    view = View(viewmats[0], Ks[0], width, height)
    splats = Splats(means, quats, scales, opacities, colors, sh_degree)
    drawn = resolve("numba", "cpu")(splats, view, settings)
    image = drawn.rgb if drawn.depth is None else torch.cat([drawn.rgb, drawn.depth], dim=-1)
    info = {"means2d": drawn.means2d, "radii": drawn.radii[None], "gaussian_ids": None}
    info |= {"width": width, "height": height, "n_cameras": 1}
    return image[None], drawn.alpha[None], info
