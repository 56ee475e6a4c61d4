"""The distractor Gaussians of one training view, seen in that view alone."""

import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import torch
from gsplat.strategy.ops import _update_param_with_optimizer as replace_rows
from jaxtyping import Float, Int
from torch import Tensor, nn

from desplat_ns.backend.protocol import View
from desplat_ns.core.devices import state_to_device
from desplat_ns.core.optimizers import adam
from desplat_ns.distractors.config import DEPTH, DistractorConfig

PLASTIC_NUMBER = 1.32471795724474602596
"""Real root of x^3 = x + 1: its powers give an even additive recurrence in the plane (R2)."""


class ViewDistractors:
    """The distractors of one training view: raw parameters, their Adam, and what their refinement
    goes by, in the shapes that gsplat's operations expect."""

    def __init__(self, start: Mapping[str, Tensor]):
        """`start`: raw parameters, N rows each, under the names that gsplat's strategy reads:
        `scales` are logarithms, `opacities` logits. N changes in training."""
        self.params = {name: nn.Parameter(value) for name, value in start.items()}
        self.optimizer = adam([{"params": [each]} for each in self.params.values()])
        """A group for each name."""
        self.state: dict[str, Any] = {"grad2d": None, "count": None, "radii": None}
        """What gsplat's strategy gathers."""
        self.refinement = 0
        """How many refinements had fallen due when the view was refined last."""

    def __len__(self) -> int:
        return len(self.params["means"])

    def begin_step(self, rates: Mapping[str, float]) -> None:
        """Make its optimizer ready for a step with these learning rates; drop gradients."""
        for name, group in zip(self.params, self.optimizer.param_groups, strict=True):
            self.params[name].grad, group["lr"] = None, rates[name]

    @property
    def optimizers(self) -> dict[str, Any]:
        """The optimizer's part for each name, as gsplat's operations expect it."""
        parts = zip(self.params, self.optimizer.param_groups, strict=True)
        state = self.optimizer.state
        return {name: SimpleNamespace(param_groups=[part], state=state) for name, part in parts}

    @torch.no_grad()
    def exchange(self, kept: Int[Tensor, " M"], new: Mapping[str, Tensor]) -> None:
        """Remove the rows but for those in `kept`, and add `new` ones, whose moments are 0. By
        numbers, as a mask's number of rows would have to be waited for each time."""

        def with_new(name: str, old: Tensor) -> Tensor:
            return nn.Parameter(torch.cat([old[kept], new[name]]))

        def with_zeros(_: str, old: Tensor) -> Tensor:
            return torch.cat([old[kept], old.new_zeros(len(new["means"]), *old.shape[1:])])

        replace_rows(with_new, with_zeros, self.params, self.optimizers)
        for key, value in self.state.items():
            if isinstance(value, Tensor):
                self.state[key] = with_zeros(key, value)

    def saved(self) -> dict[str, Any]:
        """What a checkpoint holds."""
        state = self.optimizer.state
        return {
            "params": {name: value.detach() for name, value in self.params.items()},
            "moments": {n: dict(state[p]) for n, p in self.params.items() if state.get(p)},
            "state": dict(self.state),
            "refinement": self.refinement,
        }

    def load(self, saved: Mapping[str, Any], device: torch.device) -> None:
        """Take up what `saved` gave; parameters stay the same objects."""
        for name, parameter in self.params.items():
            parameter.data = saved["params"][name].to(device, copy=True)
            parameter.grad = None
        self.optimizer.state.clear()
        for name, moments in saved["moments"].items():  # copied: Adam writes into them
            copies = {key: value.to(device, copy=True) for key, value in moments.items()}
            self.optimizer.state[self.params[name]] = copies
        self.state, self.refinement = state_to_device(saved["state"], device), saved["refinement"]


def fill_view(view: View, config: DistractorConfig) -> dict[str, Tensor]:
    """Raw parameters of distractors spread evenly over the image, of random colours (torch's
    generator); none with `start` residual.

    Source: B.3 ("1000 distractor points in every training image"); the spread is ours.
    """
    n = config.per_view if config.start == "everywhere" else 0
    # The R2 additive recurrence fills the unit square evenly.
    steps = torch.tensor([1 / PLASTIC_NUMBER, 1 / PLASTIC_NUMBER**2], dtype=torch.float64)
    unit = (0.5 + torch.arange(1, n + 1, dtype=torch.float64)[:, None] * steps) % 1.0
    size = torch.tensor([view.width, view.height])
    pixels = unit.to(view.K) * size.to(view.K)
    return distractors_at(view, max(n, 1), config, pixels, torch.rand(n, 3))


def distractors_at(
    view: View,
    places: int,
    config: DistractorConfig,
    pixels: Float[Tensor, "n 2"],
    rgbs: Float[Tensor, "n 3"],
) -> dict[str, Tensor]:
    """Raw parameters of distractors at `DEPTH` in front of a camera, of colours in [0, 1], seen at
    `pixels` (x, y). Each is half as wide as the spacing of as many `places` that cover the image.
    """
    n = len(pixels)
    fx, fy, cx, cy = view.K[0, 0], view.K[1, 1], view.K[0, 2], view.K[1, 2]
    x, y = (pixels[:, 0] - cx) / fx, (pixels[:, 1] - cy) / fy
    in_camera = torch.stack([x, y, torch.ones_like(x)], dim=-1) * DEPTH
    rotation, translation = view.viewmat[:3, :3], view.viewmat[:3, 3]
    area = view.width * view.height
    spacing = math.sqrt(area / places) / torch.sqrt(fx * fy).double()
    like = {"dtype": view.K.dtype, "device": view.K.device}
    return {
        "means": (in_camera - translation) @ rotation,
        "scales": (0.5 * spacing * DEPTH).log().to(**like).repeat(n, 3),
        "quats": torch.eye(4, **like)[:1].repeat(n, 1),
        "rgbs": rgbs.to(**like).clamp(0, 1),
        "opacities": torch.full((n, 1), config.initial_opacity, **like).logit(),
    }
