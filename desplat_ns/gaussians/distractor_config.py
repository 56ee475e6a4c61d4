"""The settings of the distractor Gaussians."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from desplat_ns.backend.constants import NEAR_PLANE
from desplat_ns.errors import ConfigError
from desplat_ns.settings.options import check_ranges, ranged

OPTION = "--pipeline.model.distractors"


@dataclass
class DistractorConfig:
    """Distractor Gaussians. Numbers of steps are nominal, of a run of the method's own length, but
    for `shaping_steps` and `refine_every`."""

    per_view: int = ranged(1000, "[0, inf)")
    """Distractor Gaussians that cover one training view. B.3."""
    start: Literal["everywhere", "residual"] = "everywhere"
    """Where distractors start: spread over the whole of every view, or, visit by visit, where a
    photo shows what the other views do not; then those elsewhere are removed, too. The paper has
    everywhere."""
    weak_excess: float = ranged(0.05, "(0, inf)")
    """With start residual: evidence that a place has to show to belong to something in the way, in
    colours in [0, 1]: its residual beyond the expected one, limited by what other photos leave
    unexplained."""
    strong_excess: float = 0.15
    """With start residual: evidence that something in the way has to show in one place at least,
    once the scene is learned; before, more."""
    shared_detail: float = ranged(0.7, "(0, inf)")
    """With start residual: where the detail of a photo correlates more than this with that of the
    static scene, it is the scene's own in another light, and nothing in the way; 1 or more asks
    nothing."""
    stop_placing_at: int = 27000
    """With start residual: step from which none is placed or removed for its place any more."""
    static_alone: bool = False
    """Train the static scene by a photometric loss of its own, on the pixels that no distractor
    covers; the composite's loss then trains distractors only. The paper has one loss for both."""
    leak: float = ranged(0.0, "[0, 1]")
    """With static_alone: weight in L1, of the static scene's own loss, of a pixel that distractors
    own, as long as the static set grows. Where most photos leave a place out nothing else moves it,
    and Adam learns it at full speed: what most photos of a place show is not in the way. Where an
    occluder hides what others show, they outvote it. The paper has one loss for both."""
    clearance: float = ranged(0.0, "[0, 1)")
    """Static Gaussians nearer to a training camera than this share of the depth at which the scene
    starts there, by the seed points, are removed: they show what stands in that photo alone. The
    paper removes none."""
    lambda_d: float = 0.01
    """Weight of the mean distractor opacity, Eq. 5. B.3."""
    lambda_s: float = 0.01
    """Weight of the mean transparency of the static scene, Eq. 5. B.3. If there is a background,
    before which the scene may be empty, it counts as 0 (B.3, Photo Tourism). With static_alone and
    a background that all photos share, it counts in what distractors own, where no photo says that
    the scene is empty."""
    static_warmup: int = 0
    """Steps for which the static scene trains alone, without distractors. The paper has none."""
    max_warmup_visits: int = ranged(15, "[0, inf)")
    """That warm-up ends after so many visits of each view at the latest: seen often enough, what
    stands in one photo alone is learned as well, and its residual is gone. It ends sooner by
    `shaping_steps`; if not, the scene's learning rates are higher by as much as it is shorter."""
    shaping_steps: int = ranged(250, "[0, inf)")
    """Steps in which a scene takes shape, once it may be refined (`warmup_length`): the warm-up
    ends after so many, or after `min_warmup_visits` if that is later. They do not shrink with the
    run: a step of Adam is as long as its rate."""
    min_warmup_visits: int = ranged(8, "[0, inf)")
    """Visits of each view for which `shaping_steps` does not end the warm-up yet; where
    `max_warmup_visits` is less, that decides."""
    stop_densify_at: int = 15000
    """Step at which distractors are no longer cloned, split or pruned. B.3."""
    refine_every: int = ranged(1, "[1, inf)")
    """Steps of the run from one refinement of distractors (cloning, splitting, pruning) to the
    next; at least the static set's interval."""
    refine_when_next_seen: bool = False
    """Refine every view's distractors each time, when the view is next seen. Otherwise only those
    of the view that is drawn in the very step, as Splatfacto's clock has it: of 40 views each one
    every 40th time."""
    refine_visits: int = ranged(0, "[0, inf)")
    """Visits of each view that they settle for in between, at least."""
    max_refinements: int = ranged(0, "[0, inf)")
    """Of a view's distractors in a run, at most, however long it is; 0 for any number."""
    grow_grad: float = ranged(0.0, "[0, inf)")
    """Distractors are cloned or split where a shift by one pixel changes the loss, summed over all
    pixels, by more than this: in colours times pixels, whatever the size of the image. 0 for the
    static set's own threshold, which is of the mean over the image."""
    min_pixels: float = ranged(0.0, "[0, inf)")
    """Distractors that make up less of the image are pruned, in pixels (`accumulated_weights`):
    where opacity costs nothing, none gets faint. 0 for none."""
    cull_to_the_end: bool = False
    """Prune distractors after `stop_densify_at` as well."""
    cull_alpha_thresh: float = 0.1
    """Distractors with less opacity are pruned. Splatfacto's threshold."""
    initial_opacity: float = ranged(0.1, "(0, 1)")
    """Opacity of a distractor at its start. Splatfacto's value."""
    depth: float = ranged(0.02, f"({NEAR_PLANE}, inf)")
    """Distance from the camera at the start, world units, whatever the scene's scale: distractors
    are composited over the static scene, so their depth only sets how many pixels a step of the
    optimizer moves them. Must lie beyond the near plane."""

    means_lr: float = ranged(1.6e-4, "[0, inf)")
    """Adam's learning rate of their positions, world units; Splatfacto's."""
    means_lr_final: float = ranged(1.6e-6, "(0, inf)")
    """To which it decays, along a straight line of its logarithm. Splatfacto's."""
    means_lr_steps: int = 30_000
    """Steps in which it does."""
    quats_lr: float = ranged(0.01, "[0, inf)")
    """Of their quaternions. B.3."""
    scales_lr: float = ranged(0.05, "[0, inf)")
    """Of the logarithms of their sizes. B.3."""
    rgbs_lr: float = ranged(0.025, "[0, inf)")
    """Of their colours. B.3."""
    opacities_lr: float = ranged(0.05, "[0, inf)")
    """Of the logits of their opacities; Splatfacto's."""

    def rates_at(self, step: int) -> dict[str, float]:
        """Learning rates at a step, by the names of parameters."""
        t = min(step / self.means_lr_steps, 1.0) if self.means_lr_steps > 0 else 1.0
        means = self.means_lr ** (1.0 - t) * self.means_lr_final**t if self.means_lr > 0 else 0.0
        return {
            "means": means,
            "quats": self.quats_lr,
            "scales": self.scales_lr,
            "rgbs": self.rgbs_lr,
            "opacities": self.opacities_lr,
        }

    def warmup_of(self, num_views: int, unrefined: int, scale: float = 1.0) -> tuple[int, int]:
        """Length of the warm-up in a run, and what it would be if `max_warmup_visits` did not end
        it; both in nominal steps, of which a step of the run makes 1 / `scale`.

        It has at most `shaping_steps` after the static set's `unrefined` first steps, or
        `min_warmup_visits` visits of each view if that is longer.
        """
        shaped = unrefined + self.shaping_steps / scale
        longer = max(shaped, self.min_warmup_visits * num_views / scale)
        wanted = min(self.static_warmup, round(longer))
        return min(wanted, round(self.max_warmup_visits * num_views / scale)), wanted

    def for_views(
        self, num_views: int, refine_every: int, unrefined: int, scale: float = 1.0
    ) -> DistractorConfig:
        """A copy whose warm-up (`warmup_of`) and interval between refinements suit the number of
        training views; both are in nominal steps, of which a step of the run makes 1 / `scale`.

        The interval is at least that of the static set, `refine_every`, and what `refine_visits`
        and `max_refinements` ask.
        """
        warmup, _ = self.warmup_of(num_views, unrefined, scale)
        every = round(max(self.refine_every, refine_every, self.refine_visits * num_views) / scale)
        if self.max_refinements > 0:
            every = max(every, math.ceil((self.stop_densify_at - warmup) / self.max_refinements))
        return replace(self, refine_every=every, static_warmup=warmup)


def check_options(config: DistractorConfig) -> None:
    """Raise ConfigError, naming the option, if one lies outside its range."""
    check_ranges(config, OPTION)
    if config.strong_excess < config.weak_excess:
        raise ConfigError(
            f"`{OPTION}.strong-excess` is {config.strong_excess}; it has to be weak-excess, "
            f"{config.weak_excess}, or more."
        )
