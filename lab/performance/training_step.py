"""A whole training step of the static scene, built from the product's own pieces, and its parts.

A step activates the raw parameters, projects them, evaluates their colours, bins, draws, puts the
picture over the background, compares it with a photo (0.8 L1 + 0.2 (1 - SSIM)), pulls the gradients
all the way back, takes an Adam step and adds to the statistics of densification. Loading the photo,
logging and densification itself, which comes every hundred steps, are not in it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import torch
from gsplat.strategy import DefaultStrategy
from torch import Tensor, nn
from torch.optim import Optimizer

from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats
from desplat_ns.calibration.scenes import SH_DEGREE, Scene
from desplat_ns.gaussians.activation import activate_static
from desplat_ns.gaussians.densification import strategy_info
from desplat_ns.rendering.compositing import over_background
from lab.pixels.contenders import Contender, as_leaves, tensors_of_projected

PROJECT, LISTS, DRAW, PULL = "projection + SH", "tile lists", "draw (forward)", "pull (backward)"
COMPOSE, LOSS, ADAM = "background, clamp", "L1 + SSIM", "Adam"
STATISTICS, OTHER = "densification statistics", "other"
PARTS = (PROJECT, LISTS, DRAW, PULL, COMPOSE, LOSS, ADAM, STATISTICS)

Ssim = Callable[[Tensor, Tensor], Tensor]
"""Of two images [H, W, 3], the rendering first."""


class Clock:
    """CPU milliseconds of the whole process by part."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = dict.fromkeys(PARTS, 0.0)
        self._since = time.process_time()

    def start(self) -> None:
        """Forget what has passed since the last part."""
        self._since = time.process_time()

    def stop(self, part: str) -> None:
        """What has passed belongs to `part`."""
        now = time.process_time()
        self.ms[part] += 1e3 * (now - self._since)
        self._since = now


class TrainingStep:
    """Steps on one scene with one rasterizer, SSIM and Adam. Learning rates are 0, so that every
    step has the same work to do; Adam's is the same at any rate."""

    def __init__(
        self,
        scene: Scene,
        contender: Contender,
        ssim: Ssim,
        make_optimizer: Callable[[str, nn.Parameter], Optimizer],
    ) -> None:
        self.contender, self.ssim, self.view = contender, ssim, scene.view
        parameters = {name: nn.Parameter(t.clone()) for name, t in scene.params.items()}
        self.params = nn.ParameterDict(parameters)
        self.optimizers = {name: make_optimizer(name, p) for name, p in parameters.items()}
        for optimizer in self.optimizers.values():
            optimizer.param_groups[0]["lr"] = 0.0
        rng = torch.Generator().manual_seed(1)
        self.photo = torch.rand(scene.view.height, scene.view.width, 3, generator=rng)
        self.background = torch.full((3,), 0.5)
        has_absgrad = contender.name != "yardstick"
        self.settings = RenderSettings(absgrad=has_absgrad)
        self.strategy = DefaultStrategy(absgrad=has_absgrad)
        self.state = self.strategy.initialize_state(scene_scale=1.0)

    def whole(self) -> None:
        """One step as it is trained."""
        self._zero_grad()
        rendering = self.contender.rasterizer(self._splats(), self.view, self.settings)
        rendering.means2d.retain_grad()
        self._loss(self._compose(rendering)).backward()
        self._adam()
        self._gather_statistics(rendering)

    def in_parts(self) -> Clock:
        """One step cut at every part's boundary: the graph is, and gradients are handed over."""
        clock, contender = Clock(), self.contender
        self._zero_grad()
        clock.stop(ADAM)
        splats = self._splats()
        projected = contender.project(splats, self.view, self.settings)
        leaves = as_leaves(projected)
        clock.stop(PROJECT)
        rendering = self._draw_in_parts(clock, splats, leaves)
        self._images_in_parts(clock, rendering)
        torch.autograd.backward(*_handed_over(projected, leaves))
        clock.stop(PROJECT)
        self._adam()
        clock.stop(ADAM)
        self._gather_statistics(rendering)
        clock.stop(STATISTICS)
        return clock

    def _draw_in_parts(self, clock: Clock, splats: Splats, leaves: Any) -> Rendering:
        make_lists = self.contender.module.tile_lists

        def timed_lists(*args: Any) -> Any:
            clock.stop(DRAW)
            lists = make_lists(*args)
            clock.stop(LISTS)
            return lists

        with self.contender.with_parts(leaves, timed_lists):
            rendering = self.contender.rasterizer(splats, self.view, self.settings)
        clock.stop(DRAW)
        return rendering

    def _images_in_parts(self, clock: Clock, rendering: Rendering) -> None:
        """From the drawn images to their gradients, and through the drawing."""
        images = [rendering.rgb, rendering.alpha]
        rgb, alpha = (image.detach().requires_grad_() for image in images)
        cut = Rendering(rgb, alpha, None, rendering.means2d, rendering.radii)
        composed = self._compose(cut)
        shown = composed.detach().requires_grad_()
        clock.stop(COMPOSE)
        self._loss(shown).backward()
        clock.stop(LOSS)
        composed.backward(shown.grad)
        clock.stop(COMPOSE)
        assert rgb.grad is not None
        torch.autograd.backward(images, [rgb.grad, alpha.grad])
        clock.stop(PULL)

    def _zero_grad(self) -> None:
        for optimizer in self.optimizers.values():
            optimizer.zero_grad()

    def _splats(self) -> Splats:
        return activate_static(self.params, SH_DEGREE)

    def _compose(self, rendering: Rendering) -> Tensor:
        return over_background(rendering.rgb, rendering.alpha, self.background).clamp(0, 1)

    def _loss(self, shown: Tensor) -> Tensor:
        """Splatfacto's photometric loss."""
        l1 = torch.abs(self.photo - shown).mean()
        return 0.8 * l1 + 0.2 * (1 - self.ssim(shown, self.photo))

    def _adam(self) -> None:
        for optimizer in self.optimizers.values():
            optimizer.step()

    def _gather_statistics(self, rendering: Rendering) -> None:
        info = strategy_info(rendering, self.view)
        self.strategy.step_post_backward(self.params, self.optimizers, self.state, 1, info)


def _handed_over(projected: Any, leaves: Any) -> tuple[list[Tensor], list[Tensor]]:
    """Projected tensors that need a gradient, and the gradients that their leaves were given."""
    pairs = zip(tensors_of_projected(projected), tensors_of_projected(leaves), strict=True)
    given = [(out, leaf.grad) for out, leaf in pairs if out.requires_grad and leaf.grad is not None]
    return [out for out, _ in given], [grad for _, grad in given]
