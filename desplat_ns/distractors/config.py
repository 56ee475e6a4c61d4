"""The settings of the distractor Gaussians, and the numbers that all methods share.

Steps are nominal, of a run of the method's own length, but for `WARMUP_STEPS` and
`SHAPING_STEPS`.
"""

from dataclasses import dataclass
from typing import Literal

from desplat_ns.core.options import ranged
from desplat_ns.core.schedule import NominalStep

DEPTH = 0.02
"""Distance from the camera at the start, world units: distractors are composited over the static
scene, so it only sets how many pixels a step of the optimizer moves them. Beyond the near plane."""

STOP_DENSIFY_AT = 15_000
"""Step from which distractors are no longer cloned or split, only pruned. B.3."""

CULL_ALPHA = 0.1
"""Distractors with less opacity are pruned, to the end: Splatfacto's threshold, and its rule in
nerfstudio 1.1.4."""

RATES = {"quats": 0.01, "scales": 0.05, "rgbs": 0.025, "opacities": 0.05}
"""Adam's learning rates of the logarithms of their sizes, the logits of their opacities, and the
rest. B.3; that of opacities is Splatfacto's."""

MEANS_RATE, FINAL_MEANS_RATE, MEANS_RATE_STEPS = 1.6e-4, 1.6e-6, 30_000
"""That of their positions, world units, falls along a straight line of its logarithm in so many
steps. Splatfacto's."""

MAX_WARMUP = 6_000
"""A warm-up by rule ends at this step at the latest: at a fifth of a run of 30,000."""

WARMUP_STEPS, WARMUP_VISITS = 120, (8, 15)
"""A warm-up by rule has so many steps of the run, but at least and at most so many visits of each
view: what stands in one photo alone is learned in time."""

SHAPING_STEPS = 250
"""Steps of the run in which a scene takes shape, once it may be refined. Where the warm-up is
shorter, learning rates are higher meanwhile (`early_rate_factor`). Steps do not shrink with the
run: one of Adam is as long as its rate."""

MOST_REFINEMENTS = 8
"""Of a view's distractors in a run, however long it is, with `start` residual."""


@dataclass
class DistractorConfig:
    """Distractor Gaussians."""

    per_view: int = ranged(1000, "[0, inf)")
    """Distractor Gaussians that cover one training view, with `start` everywhere. B.3."""
    start: Literal["everywhere", "residual"] = "everywhere"
    """Where distractors start: spread over every view and refined by Splatfacto's rules, as in the
    paper; or, visit by visit, where a photo shows what the other views do not, and only there."""
    strong_excess: float = ranged(0.15, "(0, inf)")
    """With start residual: evidence that something in the way has to show, in or beside most of its
    cells; before the scene is learned one shows more. It is the residual beyond the expected one,
    limited by what other photos leave unexplained, of colours in [0, 1]."""
    static_alone: bool = False
    """Train the static scene by a photometric loss of its own, on the pixels that no distractor
    covers; the composite's loss then trains distractors only. The paper has one loss for both."""
    leak: float = ranged(0.0, "[0, 1]")
    """With static_alone: weight in L1, of the static scene's own loss, of a pixel that distractors
    own, as long as the static set grows: what most photos of a place show is then learned, although
    they leave it out."""
    lambda_d: float = ranged(0.01, "[0, inf)")
    """Weight of the mean distractor opacity, Eq. 5, in regions of transparency. B.3."""
    lambda_s: float = ranged(0.01, "[0, inf)")
    """Weight of the mean transparency of the static scene, Eq. 5. B.3. If there is a background it
    counts as 0 (B.3, Photo Tourism); with static_alone and a background that all photos share, it
    counts in what distractors own."""
    static_warmup: int | None = ranged(0, f"[0, {STOP_DENSIFY_AT}]")
    """Steps for which the static scene trains alone, without distractors; None for as many as the
    number of photos asks for (`warmup_of`). The paper has none."""
    refine_visits: int = ranged(10, "[1, inf)")
    """Visits of each view between two refinements of its distractors. The authors' code has 10."""
    initial_opacity: float = ranged(0.1, "(0, 1)")
    """Opacity of a distractor at its start. Splatfacto's value."""

    def warmup_of(self, num_views: int, unrefined: int, scale: float = 1.0) -> tuple[int, int]:
        """Length of the warm-up in a run, and of the time in which the scene takes shape, at least
        as long; both in nominal steps, of which a step of the run makes 1 / `scale`. `unrefined`:
        first steps in which the static set is not refined.
        """
        if self.static_warmup is not None:
            return self.static_warmup, self.static_warmup
        least, most = (visits * num_views for visits in WARMUP_VISITS)
        warmup = min(MAX_WARMUP, round(min(max(least, WARMUP_STEPS), most) / scale))
        return warmup, min(MAX_WARMUP, max(warmup, round(unrefined + SHAPING_STEPS / scale)))

    @property
    def warmup(self) -> NominalStep:
        """Length of the warm-up, of what `DeSplatModelConfig.for_run` gave."""
        assert self.static_warmup is not None
        return NominalStep(self.static_warmup)

    def steps_between_refinements(self, num_views: int, scale: float = 1.0) -> int:
        """Nominal steps from one refinement to the next, of what `for_run` gave."""
        every = self.refine_visits * num_views / scale
        if self.start == "residual":
            every = max(every, (STOP_DENSIFY_AT - self.warmup) / MOST_REFINEMENTS)
        return max(1, round(every))


def rates_at(step: int) -> dict[str, float]:
    """Learning rates of distractors at a step, by the names of parameters."""
    t = min(step / MEANS_RATE_STEPS, 1.0)
    return {"means": MEANS_RATE ** (1.0 - t) * FINAL_MEANS_RATE**t, **RATES}
