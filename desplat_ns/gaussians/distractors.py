"""The distractor Gaussians: a set of its own for each training view, seen in that view alone."""

from __future__ import annotations

import math
from typing import Any

import torch
from jaxtyping import Float
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor, nn

from desplat_ns.backend.protocol import View
from desplat_ns.gaussians.activation import resize_rows
from desplat_ns.gaussians.distractor_config import DistractorConfig, check_options
from desplat_ns.gaussians.parameters_of_views import ParametersOfViews
from desplat_ns.rendering.views import view_of

PARAMETER_NAMES = ("means", "scales", "quats", "rgbs", "opacities")
"""Raw values, under the names that gsplat's strategy reads: scales are logarithms, opacities
logits."""

PLASTIC_NUMBER = 1.32471795724474602596
"""Real root of x^3 = x + 1: its powers give an even additive recurrence in the plane (R2)."""


class DistractorGaussians(nn.Module):
    """Raw parameters of every training view's distractors.

    `views[i]` maps `PARAMETER_NAMES` to tensors of N_i rows; N_i changes as training goes on, and a
    view with N_i = 0 costs nothing. Kept outside Splatfacto's `gauss_params`, so that what exports
    those never sees distractors.
    """

    def __init__(self, config: DistractorConfig, cameras: Cameras):
        """Start every view's distractors in front of its camera.

        Args:
            cameras: the training cameras, shape [V].

        Raises:
            ConfigError: if a setting lies outside its range.
        """
        super().__init__()
        check_options(config)
        self.views = nn.ModuleList()
        for i in range(len(cameras)):
            start = fill_view(view_of(cameras[i : i + 1]), config)
            params = {name: nn.Parameter(start[name]) for name in PARAMETER_NAMES}
            self.views.append(nn.ParameterDict(params))
        self.drawn: list[int] = []
        """Views of which there may be gradients; see `draws`."""
        self._counts = self.counts()
        self.total = sum(self._counts)
        """Number of Gaussians of all views, as `recount` keeps it."""

    def train(self, mode: bool = True) -> DistractorGaussians:
        """For this module alone: parameters know no mode, and nerfstudio 1.1.5 calls it in every
        step, which took 5 ms for 1,700 views."""
        self.training = mode
        return self

    def params_of(self, view: int) -> nn.ParameterDict:
        """Parameters of one training view."""
        params = self.views[view]
        assert isinstance(params, nn.ParameterDict)
        return params

    def count_of(self, view: int) -> int:
        """Number of Gaussians that one training view has left."""
        return self.params_of(view)["means"].shape[0]

    def counts(self) -> list[int]:
        """Number of Gaussians of every training view, counted anew."""
        return [self.count_of(view) for view in range(len(self.views))]

    def recount(self, view: int) -> None:
        """Bring `total` up to date after a step that may have changed one view's number."""
        count = self.count_of(view)
        self.total += count - self._counts[view]
        self._counts[view] = count

    def draws(self, view: int) -> None:
        """Note that a view is drawn in training; forget others, unless they still have gradients
        because those of several steps are accumulated."""
        others = [(one, self.params_of(one)) for one in self.drawn if one != view]
        kept = [n for n, params in others if any(p.grad is not None for p in params.values())]
        self.drawn[:] = [*kept, view]

    def param_groups(self) -> dict[str, list[nn.Parameter]]:
        """One optimizer group for each kind of parameter, over all views.

        A view that was not rendered has no gradient, so Adam leaves its Gaussians and their moments
        alone.
        """
        views = [self.params_of(view) for view in range(len(self.views))]
        return {
            f"distractor_{name}": ParametersOfViews((one[name] for one in views), self.drawn)
            for name in PARAMETER_NAMES
        }

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *args: Any) -> None:
        """torch's hook, called before the views load: each takes the saved number of Gaussians."""
        for view in range(len(self.views)):
            resize_rows(self.params_of(view), state_dict, f"{prefix}views.{view}.")
            self.recount(view)
        super()._load_from_state_dict(state_dict, prefix, *args)

    @torch.no_grad()
    def keep_colors_in_range(self, view: int) -> None:
        """Put colours that a step moved beyond [0, 1] back on the border.

        The clamp in rendering has no gradient beyond the border: a colour left there would stay.
        """
        self.params_of(view)["rgbs"].clamp_(0, 1)


def fill_view(view: View, config: DistractorConfig) -> dict[str, Tensor]:
    """Raw parameters of distractors spread evenly over the image; none with `start` residual.

    Colours are random (torch's generator).

    Source: B.3 ("1000 distractor points in every training image"); the spread is ours.
    """
    n = config.per_view if config.start == "everywhere" else 0
    size = torch.tensor([view.width, view.height])
    return distractors_at(
        view, config, even_points(n).to(view.K) * size.to(view.K), torch.rand(n, 3)
    )


def distractors_at(
    view: View,
    config: DistractorConfig,
    pixels: Float[Tensor, "n 2"],
    rgbs: Float[Tensor, "n 3"],
) -> dict[str, Tensor]:
    """Raw parameters of distractors at `config.depth` in front of a camera.

    Each is half as wide as the spacing of `config.per_view` that would cover the image.

    Args:
        pixels: where they are seen, x and y.
        rgbs: in [0, 1].
    """
    n = len(pixels)
    fx, fy, cx, cy = view.K[0, 0], view.K[1, 1], view.K[0, 2], view.K[1, 2]
    x, y = (pixels[:, 0] - cx) / fx, (pixels[:, 1] - cy) / fy
    in_camera = torch.stack([x, y, torch.ones_like(x)], dim=-1) * config.depth
    rotation, translation = view.viewmat[:3, :3], view.viewmat[:3, 3]
    area = view.width * view.height
    spacing = math.sqrt(area / max(config.per_view, 1)) / torch.sqrt(fx * fy).double()
    like = {"dtype": view.K.dtype, "device": view.K.device}
    return {
        "means": (in_camera - translation) @ rotation,
        "scales": (0.5 * spacing * config.depth).log().to(**like).repeat(n, 3),
        "quats": torch.eye(4, **like)[:1].repeat(n, 1),
        "rgbs": rgbs.to(**like),
        "opacities": torch.full((n, 1), config.initial_opacity, **like).logit(),
    }


def even_points(n: int) -> Float[Tensor, "n 2"]:
    """`n` points that fill the unit square evenly: the R2 additive recurrence, in float64."""
    steps = torch.tensor([1 / PLASTIC_NUMBER, 1 / PLASTIC_NUMBER**2], dtype=torch.float64)
    index = torch.arange(1, n + 1, dtype=torch.float64)
    return (0.5 + index[:, None] * steps) % 1.0
