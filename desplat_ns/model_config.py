"""The settings of a DeSplat model, and what they are in a run of a given length and capture."""

import math
from dataclasses import dataclass, field, replace
from importlib import import_module

import torch
from nerfstudio.models.splatfacto import SplatfactoModelConfig

from desplat_ns.backend import BackendName
from desplat_ns.backend.spherical_harmonics import MAX_DEGREE
from desplat_ns.core.cores import memory as machine_memory
from desplat_ns.core.effects import EffectsConfig
from desplat_ns.core.options import check_ranges, ranged
from desplat_ns.core.schedule import SPLATFACTOS_INTERVAL
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.gaussians.strategy import UNLIMITED
from desplat_ns.photo_tourism.config import AppearanceConfig

BYTES_A_GAUSSIAN = 4 * 59 * 8
"""Memory of one more static Gaussian in training: 59 numbers in float32, and as many of gradients,
moments, what is drawn and what is kept; 1,875 bytes were measured (docs/results/speed.md)."""

MEMORY_SHARE = 0.5
"""Of the memory; the rest is for photos, images and other programs."""

SIZES = 4
"""Sizes that photos have from one to twice their sides as they grow: a few, since a GPU keeps what
it needs for each."""

FULL_SIZE_OCTAVES = 2
"""Photos of at most 2^2 times `first_megapixels` have their full size from the start, and those of
2^3 times start at `first_megapixels`: less saves little time, and costs quality
(docs/results/speed.md, "Photos of real size")."""


@dataclass
class DeSplatModelConfig(SplatfactoModelConfig):
    """Splatfacto's settings, and those of DeSplat.

    Numbers of steps are nominal, of a run of the method's own length, unless they say otherwise.
    """

    _target: type = field(default_factory=lambda: import_module("desplat_ns.model").DeSplatModel)
    effects: EffectsConfig = field(default_factory=EffectsConfig)
    """Which effects the scene calls for."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """Per-image appearance, where `effects.appearance` has it."""
    backend: BackendName = "auto"
    """Rasterizer. auto takes gsplat on CUDA, and numba on the CPU."""
    schedule_scale: float | None = ranged(None, "(0, inf)")
    """Steps of the run for each nominal step; by default max-num-iterations over the method's own
    number, at most 1."""
    refine_every: int = ranged(0, "[0, inf)")
    """Steps of the run between two refinements of the static set, at most; 0 for no bound.
    Splatfacto has 100, in runs of any length."""
    sh_degree: int = ranged(3, f"[0, {MAX_DEGREE}]")
    """Degree of the harmonics in which static Gaussians hold their colours."""
    sh_degree_interval: int = ranged(1000, "[1, inf)")
    """Steps after which one degree more is learned."""
    refinements: int = ranged(15, "[1, inf)")
    """Refinements of the static set in a run, at least half a round of the views apart. See
    docs/explain/separation.md, "How often Gaussians are refined"."""
    first_megapixels: float = ranged(0.0, "[0, inf)")
    """Size of large training photos at the start. Their sides grow by equal factors in equal times,
    and reach their full length when Splatfacto's would, after `num_downscales` times
    `resolution_schedule` steps. The threshold of growth is divided by the root of the reduction at
    the start. 0 for Splatfacto's sizes (2^num_downscales times smaller, halved every
    `resolution_schedule` steps) and its threshold."""
    train_downscale: int = ranged(1, "[1, inf)")
    """Factor by which photos are smaller in training at least; renderings have their full size."""
    gaussians_per_pixel: float = ranged(0.0, "[0, inf)")
    """Static Gaussians at most, per pixel of all training photos together: more than the photos can
    hold in place become floaters. 0 for no such limit, as in the paper. In any case at most as many
    as fit into memory. A capture that starts with more keeps those, but does not grow."""
    opacity_prior: float = ranged(0.0, "[0, inf)")
    """Weight of the mean opacity of the static Gaussians that a photo shows, divided by the number
    of training photos: what no photo needs fades and is pruned (docs/explain/separation.md, "What
    the static scene trains on"). 0 in the paper, and with `effects.appearance` affine or sh."""
    near_plane: float = ranged(0.0, "[0, 1)")
    """Renderings leave out static Gaussians that are nearer than this share of the depth at which
    the seed points in the view start, and those before that start that reach the camera
    (`stands_clear`): what hangs there contradicts no photo, and hides the scene. Training draws
    them. 0 in the paper: nothing is left out."""
    long_axis_split: bool = False
    """Let a static Gaussian grow into two halves of it, one behind the other along its longest
    axis. Splatfacto and the paper clone small ones, and draw two within a large one at random."""
    cull_to_the_end: bool = False
    """Prune faint static Gaussians after `stop_split_at` as well. Splatfacto did so when the paper
    was written (nerfstudio 1.1.4: `continue_cull_post_densification`)."""
    distractors: DistractorConfig = field(default_factory=DistractorConfig)
    """Distractor Gaussians."""

    def for_run(self, num_views: int) -> "DeSplatModelConfig":
        """A copy for one run, its intervals as the number of training views wants them. Raises
        ConfigError where a setting lies outside its range."""
        check_ranges(self, "--pipeline.model")
        run, scale = replace(self), self.schedule_scale or 1.0
        densification = max(1, round(self.stop_split_at * scale))
        # gradients averaged over fewer than half of the views are mostly noise
        every = max(num_views // 2, math.ceil(densification / self.refinements))
        run.refine_every = min(every, self.refine_every) if self.refine_every > 0 else every
        if self.effects.settled().appearance in ("affine", "sh"):
            run.opacity_prior = 0.0
        run.distractors = replace(self.distractors, static_warmup=self.warmup_of(num_views)[0])
        return run

    def warmup_of(self, num_views: int) -> tuple[int, int]:
        """`DistractorConfig.warmup_of` a run; no steps without distractors."""
        if not self.effects.settled().distractors:
            return 0, 0
        scale = self.schedule_scale or 1.0
        return self.distractors.warmup_of(num_views, self.warmup_length, scale)

    def downscale_factor(self, step: int, pixels: int) -> float:
        """By how much the sides of photos of so many pixels are smaller at a nominal step."""
        first, end = self.first_megapixels, self.num_downscales * self.resolution_schedule
        if first > 0:
            left = max(0.0, 1.0 - step / end) if end > 0 else 0.0
            octaves = math.log2(max(1.0, pixels / (1e6 * first)))
            halvings = 0.5 * octaves * min(1.0, max(0.0, octaves - FULL_SIZE_OCTAVES))
            reduced = 2.0 ** (round(SIZES * halvings * left) / SIZES)
        else:
            reduced = 2.0 ** max(0, self.num_downscales - step // self.resolution_schedule)
        return max(float(self.train_downscale), reduced)

    @property
    def reset_every(self) -> int:
        """Nominal steps from one reset of the static opacities to the next."""
        steps = self.reset_alpha_every * SPLATFACTOS_INTERVAL
        return steps if steps > 0 else UNLIMITED  # 0: no resets

    def most_gaussians(self, pixels: int, device: str | torch.device) -> int:
        """Static Gaussians beyond which the set does not grow, by the pixels of all training photos
        together and the memory of the device."""
        device = torch.device(device)
        if device.type == "cuda":
            memory = torch.cuda.get_device_properties(device).total_memory
        else:
            memory = machine_memory()[0]  # what is built in: the same at any load
        room = int(MEMORY_SHARE * memory) // BYTES_A_GAUSSIAN
        wanted = round(self.gaussians_per_pixel * pixels)
        return min(wanted, room) if self.gaussians_per_pixel > 0 else room
