"""The distractor Gaussians: a set of its own for each training view, seen in that view alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import torch
from jaxtyping import Float
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor, nn

from desplat_ns.backend.protocol import RenderSettings, View
from desplat_ns.errors import ConfigError
from desplat_ns.gaussians.activation import resize_rows
from desplat_ns.gaussians.parameters_of_views import ParametersOfViews
from desplat_ns.options import check_finite_options
from desplat_ns.rendering.views import view_of

PARAMETER_NAMES = ("means", "scales", "quats", "rgbs", "opacities")
"""Raw values, under the names that gsplat's strategy reads: scales are logarithms, opacities
logits."""

PLASTIC_NUMBER = 1.32471795724474602596
"""Real root of x^3 = x + 1: its powers give an even additive recurrence in the plane (R2)."""


@dataclass
class DistractorConfig:
    """Distractor Gaussians. Numbers of steps are the full schedule's and shrink with it."""

    per_view: int = 1000
    """Distractor Gaussians that cover one training view. B.3."""
    start: Literal["everywhere", "residual"] = "everywhere"
    """Where distractors start: spread over the whole of every view, or, visit by visit, where a
    photo shows what the other views do not; then those elsewhere are removed, too. The paper has
    everywhere."""
    weak_excess: float = 0.04
    """With start residual: by how much a residual (colours in [0, 1]) has to exceed the expected
    one for a place to belong to something in the way."""
    strong_excess: float = 0.25
    """With start residual: excess that something in the way has to reach in one place at least,
    while the scene is not learned yet."""
    settled_share: float = 0.6
    """Share of `strong_excess` that is enough in the end: once the scene is learned, what differs
    little from what it covers can be told from it."""
    strong_levels: float = 20.0
    """What has to be reached lies between the two and is so many times the view's own level, the
    lower quartile of its residuals: that falls as the scene is learned."""
    leave_out_at: int = 12000
    """With start residual and static_alone: step from which the static scene's own loss leaves out
    whole regions. Until then only what distractors cover, so that the scene gets a chance to learn
    what several photos show."""
    stop_placing_at: int = 27000
    """With start residual: step from which none is placed or removed for its place any more."""
    static_alone: bool = False
    """Train the static scene by a photometric loss of its own, on the pixels that no distractor
    covers; the composite's loss then trains distractors only. The paper has one loss for both."""
    clearance: float = 0.0
    """Static Gaussians nearer to a training camera than this share of the depth at which the scene
    starts there, by the seed points, are removed: they show what stands in that photo alone. The
    paper removes none."""
    lambda_d: float = 0.01
    """Weight of the mean distractor opacity, Eq. 5. B.3."""
    lambda_s: float = 0.01
    """Weight of the mean transparency of the static scene, Eq. 5. B.3. It counts as 0 if there is a
    background, before which the scene may be empty (B.3, Photo Tourism)."""
    static_warmup: int = 0
    """Steps for which the static scene trains alone, without distractors. The paper has none."""
    max_warmup_visits: int = 15
    """That warm-up ends after so many visits of each view at the latest, and `leave_out_at` comes
    after twice as many, however long the run: seen often enough, what stands in one photo alone is
    learned as well, and its residual is gone."""
    stop_densify_at: int = 15000
    """Step at which distractors are no longer cloned, split or pruned. B.3."""
    refine_every: int = 1
    """Steps from one refinement of distractors (cloning, splitting, pruning) to the next; at least
    the static set's interval."""
    refine_when_next_seen: bool = False
    """Refine every view's distractors each time, when the view is next seen. Otherwise only those
    of the view that is drawn in the very step, as Splatfacto's clock has it: of 40 views each one
    every 40th time."""
    refine_visits: int = 0
    """Visits of each view that they settle for in between, at least."""
    max_refinements: int = 0
    """Of a view's distractors in a run, at most, however long it is; 0 for any number."""
    grow_grad: float = 0.0
    """Distractors are cloned or split where a shift by one pixel changes the loss, summed over all
    pixels, by more than this: in colours times pixels, whatever the size of the image. 0 for the
    static set's own threshold, which is of the mean over the image."""
    min_pixels: float = 0.0
    """Distractors that make up less of the image are pruned, in pixels (`contributions`): where
    opacity costs nothing, none gets faint. 0 for none."""
    cull_to_the_end: bool = False
    """Prune distractors after `stop_densify_at` as well."""
    cull_alpha_thresh: float = 0.1
    """Distractors with less opacity are pruned. Splatfacto's threshold."""
    initial_opacity: float = 0.1
    """Opacity of a distractor at its start. Splatfacto's value."""
    depth: float = 0.02
    """Distance from the camera at the start, world units, whatever the scene's scale: distractors
    are composited over the static scene, so their depth only sets how many pixels a step of the
    optimizer moves them. Must lie beyond the near plane."""

    def for_views(self, num_views: int, refine_every: int) -> DistractorConfig:
        """A copy whose warm-up and interval between refinements suit the number of training views.

        The warm-up has at most `max_warmup_visits` visits of each view. The interval is at least
        that of the static set, `refine_every`, and what `refine_visits` and `max_refinements` ask.
        """
        most = self.max_warmup_visits * num_views
        warmup = min(self.static_warmup, most)
        every = max(self.refine_every, refine_every, self.refine_visits * num_views)
        if self.max_refinements > 0:
            every = max(every, math.ceil((self.stop_densify_at - warmup) / self.max_refinements))
        return replace(
            self,
            refine_every=every,
            static_warmup=warmup,
            leave_out_at=min(self.leave_out_at, 2 * most),
        )


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
        _check(config)
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


def _check(config: DistractorConfig) -> None:
    check_finite_options(config, "--pipeline.model.distractors")
    near = RenderSettings.near_plane
    for name, found, fits, needed in (
        ("depth", config.depth, config.depth > near, f"beyond the near plane at {near}"),
        ("per-view", config.per_view, config.per_view >= 0, "0 or more"),
        ("clearance", config.clearance, 0 <= config.clearance < 1, "at least 0 and below 1"),
        ("max-warmup-visits", config.max_warmup_visits, config.max_warmup_visits >= 0, "0 or more"),
        ("settled-share", config.settled_share, 0 < config.settled_share <= 1, "in (0, 1]"),
        ("strong-levels", config.strong_levels, config.strong_levels >= 0, "0 or more"),
        ("refine-every", config.refine_every, config.refine_every >= 1, "1 or more"),
        ("refine-visits", config.refine_visits, config.refine_visits >= 0, "0 or more"),
        ("max-refinements", config.max_refinements, config.max_refinements >= 0, "0 or more"),
        ("grow-grad", config.grow_grad, config.grow_grad >= 0, "0 or more"),
        ("min-pixels", config.min_pixels, config.min_pixels >= 0, "0 or more"),
        (
            "strong-excess",
            config.strong_excess,
            config.strong_excess >= config.weak_excess > 0,
            f"positive and not below weak-excess, {config.weak_excess}",
        ),
        (
            "initial-opacity",
            config.initial_opacity,
            0 < config.initial_opacity < 1,
            "inside (0, 1)",
        ),
    ):
        if not fits:
            raise ConfigError(
                f"`--pipeline.model.distractors.{name}` is {found}; it has to be {needed}."
            )


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
