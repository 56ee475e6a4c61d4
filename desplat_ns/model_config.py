"""The model's settings, and how they shrink with the length of a run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from nerfstudio.models.splatfacto import SplatfactoModelConfig

from desplat_ns.backend import BackendName
from desplat_ns.distractors import DistractorConfig
from desplat_ns.effects import EffectsConfig
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.schedules import scaled_steps

STATIC_STEPS = (
    "warmup_length",
    "refine_every",
    "resolution_schedule",
    "sh_degree_interval",
    "stop_screen_size_at",
    "stop_split_at",
)
"""Splatfacto's settings that are numbers of steps."""

MIN_REFINE_EVERY = 10
"""Steps. A refinement judges by gradients averaged since the last one; over fewer views noise
clones Gaussians without end (150 steps at an interval of 1 made 104,000 out of 4,700)."""

MIN_RESET_EVERY = 4
"""Refinements. Splatfacto rests after each reset of the opacities; were resets closer than this,
there would be no refinement between two of them."""

MIN_REFINE_VISITS = 5
"""The same for distractors, which need these visits to settle: refined at every visit, 40 views of
135 x 240 pixels came to 16,000 Gaussians each within 37 visits."""

DISTRACTOR_STEPS = (
    "static_warmup",
    "leave_out_at",
    "stop_densify_at",
    "stop_placing_at",
    "refine_every_visits",
)
"""The distractors' settings that are numbers of steps, or of visits."""


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

    def scaled(self) -> DeSplatModelConfig:
        """A copy whose numbers of steps are shrunk by `schedule_scale`."""
        scale = self.schedule_scale or 1.0
        steps = _scaled(self, STATIC_STEPS, scale)
        reset = scaled_steps(self.reset_alpha_every * self.refine_every, scale)
        visits = _scaled(self.distractors, DISTRACTOR_STEPS, scale)
        if scale < 1:
            steps["refine_every"] = max(steps["refine_every"], MIN_REFINE_EVERY)
            visits["refine_every_visits"] = max(visits["refine_every_visits"], MIN_REFINE_VISITS)
        return replace(
            self,
            **steps,
            reset_alpha_every=max(MIN_RESET_EVERY, round(reset / steps["refine_every"])),
            distractors=replace(self.distractors, **visits),
        )

    def for_views(self, num_views: int) -> DeSplatModelConfig:
        """A copy whose distractors' warm-up suits the number of training views.

        A warm-up that ends before photos have their full size makes them start at half of it: in
        smaller ones, occluders do not stand out enough to be found, and are learned. Call it on
        what `scaled` gave.
        """
        distractors = self.distractors.for_views(num_views)
        full_size_at = self.num_downscales * self.resolution_schedule
        if not (self.effects.distractors and 0 < distractors.static_warmup < full_size_at):
            return replace(self, distractors=distractors)
        return replace(
            self, distractors=distractors, num_downscales=1, resolution_schedule=full_size_at
        )

    def pause_after_reset(self, num_views: int) -> int:
        """Steps without refinement after a reset of the opacities, Splatfacto's rule: until every
        view could be seen once (scaled as all steps) and one interval more.

        Call it on what `scaled` gave.
        """
        return scaled_steps(num_views, self.schedule_scale or 1.0) + self.refine_every


def _scaled(config: Any, names: Iterable[str], scale: float) -> dict[str, int]:
    return {name: scaled_steps(getattr(config, name), scale) for name in names}
