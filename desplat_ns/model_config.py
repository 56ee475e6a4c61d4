"""The model's settings, and how they shrink with the length of a run."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from nerfstudio.models.splatfacto import SplatfactoModelConfig

from desplat_ns.backend import BackendName
from desplat_ns.effects import EffectsConfig
from desplat_ns.errors import ConfigError
from desplat_ns.gaussians.distractors import DistractorConfig
from desplat_ns.gaussians.strategy import NEVER
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.training.run_length import scaled_steps

STATIC_STEPS = (
    "warmup_length",
    "resolution_schedule",
    "sh_degree_interval",
    "stop_screen_size_at",
    "stop_split_at",
)
"""Splatfacto's settings that are numbers of steps."""

SPLATFACTOS_INTERVAL = 100
"""Steps. Splatfacto counts its resets in refinements of this many steps, and lets the scene recover
from one for as long (and a round of the views); ours do so whatever the interval."""

DISTRACTOR_STEPS = (
    "static_warmup",
    "leave_out_at",
    "stop_densify_at",
    "stop_placing_at",
)
"""The distractors' settings that are numbers of steps."""


def _model_class() -> type:
    from desplat_ns.model import DeSplatModel  # imports this module

    return DeSplatModel


@dataclass
class DeSplatModelConfig(SplatfactoModelConfig):
    """DeSplat on top of Splatfacto.

    Every number of steps belongs to the full schedule; `schedule_scale` shrinks them all.
    """

    _target: type = field(default_factory=_model_class)
    effects: EffectsConfig = field(default_factory=EffectsConfig)
    """Which effects the scene calls for."""
    distractors: DistractorConfig = field(default_factory=DistractorConfig)
    """Distractor Gaussians."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """Per-image appearance, where `effects.appearance` has it."""
    background: BackgroundConfig = field(default_factory=BackgroundConfig)
    """Background model, where `effects.background` has it."""
    backend: BackendName = "auto"
    """Rasterizer. auto takes gsplat where CUDA works, else the fastest that runs on the CPU."""
    schedule_scale: float | None = None
    """Factor on every number of steps; by default max-num-iterations over the method's own number,
    at most 1."""

    refine_every: int = 0
    """Steps between two refinements of the static set, at most; 0 for no bound. Splatfacto has 100,
    in runs of any length."""
    refinements: int = 15
    """Refinements that a run has time for, however long it is: they are as many steps apart as
    `stop_split_at` has by this number, and at least half a round of the views. See
    docs/separation.md, "How often, and how many"."""
    gaussians_per_pixel: float = 0.0
    """Static Gaussians at most, per pixel of all training photos together: more than the photos can
    hold in place become floaters. 0 for no limit, as in the paper. A capture that starts with more
    keeps those, but does not grow."""
    cull_to_the_end: bool = False
    """Prune faint static Gaussians after `stop_split_at` as well. Splatfacto did so when the paper
    was written (nerfstudio 1.1.4: `continue_cull_post_densification`)."""

    def scaled(self) -> DeSplatModelConfig:
        """A copy whose numbers of steps are shrunk by `schedule_scale`."""
        scale = self.schedule_scale or 1.0
        distractors = _scaled(self.distractors, DISTRACTOR_STEPS, scale)
        return replace(
            self,
            **_scaled(self, STATIC_STEPS, scale),
            distractors=replace(self.distractors, **distractors),
        )

    def for_views(self, num_views: int) -> DeSplatModelConfig:
        """A copy whose intervals suit the number of training views. Call it on what `scaled` gave.

        Between two refinements gradients are sampled, over half of the views at least: over fewer
        they are mostly noise.

        Raises:
            ConfigError: a setting lies outside its range.
        """
        self._check()
        every = max(num_views // 2, math.ceil(self.stop_split_at / self.refinements))
        if self.refine_every > 0:
            every = min(every, self.refine_every)
        distractors = self.distractors.for_views(num_views, every)
        return replace(self, refine_every=every, distractors=distractors)

    def _check(self) -> None:
        for name, value, least in (
            ("refine-every", self.refine_every, 0),
            ("refinements", self.refinements, 1),
            ("gaussians-per-pixel", self.gaussians_per_pixel, 0),
        ):
            if not value >= least:
                raise ConfigError(
                    f"`--pipeline.model.{name}` is {value}; it has to be {least} or more."
                )

    def downscale_factor(self, step: int) -> int:
        """By how much photos are smaller at a step: 2^num_downscales at first, halved every
        `resolution_schedule` steps.

        With distractors that have a warm-up, whatever is below half the size is over by the middle
        of it: in smaller photos occluders do not stand out enough to be found, and are learned.
        Call it on what `scaled` and `for_views` gave.
        """
        every = self.resolution_schedule
        if step >= self.num_downscales * every:
            return 1
        warmup = self.distractors.static_warmup if self.effects.distractors else 0
        if warmup == 0 or self.num_downscales == 1:
            return 2 ** (self.num_downscales - step // every)
        early = max(1, min(every, warmup // (2 * (self.num_downscales - 1))))
        return 2 ** max(1, self.num_downscales - step // early)

    @property
    def reset_every(self) -> int:
        """Steps from one reset of the static opacities to the next; `reset_alpha_every` 0: none."""
        steps = self.reset_alpha_every * SPLATFACTOS_INTERVAL
        return scaled_steps(steps, self.schedule_scale or 1.0) if steps > 0 else NEVER

    def pause_after_reset(self, num_views: int) -> int:
        """Steps after a reset in which the scene recovers and nothing is sampled for refinement.

        Splatfacto's rule, a round of the views and one of its intervals, but half the time to the
        next reset at most.
        """
        return min(num_views + SPLATFACTOS_INTERVAL, self.reset_every // 2)

    def most_gaussians(self, pixels: int) -> int:
        """Static Gaussians beyond which the set does not grow.

        Args:
            pixels: of all training photos together.
        """
        return round(self.gaussians_per_pixel * pixels) if self.gaussians_per_pixel > 0 else NEVER


def _scaled(config: Any, names: Iterable[str], scale: float) -> dict[str, int]:
    return {name: scaled_steps(getattr(config, name), scale) for name in names}
