"""A small scene that is known well, for what looks for things in the way."""

from dataclasses import replace
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.models.splatfacto import SplatfactoModelConfig

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.cameras.views import view_of
from desplat_ns.core.effects import BackgroundGrade
from desplat_ns.core.schedule import NominalStep, RunStep
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.distractors import Distractors
from desplat_ns.separation.decide import Thresholds
from desplat_ns.separation.residuals import RESIDUAL_MEDIANS
from desplat_ns.step import Step

WIDTH, HEIGHT = 60, 40


def cameras() -> Cameras:
    turn = torch.tensor([[0.0, 0, 1, 2], [0, 1, 0, -1], [-1, 0, 0, 3]])  # not the identity
    return Cameras(turn[None], 50.0, 55.0, 29.0, 21.0, WIDTH, HEIGHT)


def the_view() -> View:
    return view_of(cameras())


def nothing_drawn() -> Rendering:
    image, alpha = torch.zeros(HEIGHT, WIDTH, 3), torch.zeros(HEIGHT, WIDTH, 1)
    return Rendering(image, alpha, None, torch.zeros(1, 0, 2), torch.zeros(0).int())


class WellKnownScene:
    """Textured blocks, rendered with noise; every pixel has a Gaussian."""

    def __init__(self) -> None:
        self.generator, self.noise = torch.Generator().manual_seed(0), 0.02
        blocks = torch.rand(HEIGHT // 4, WIDTH // 4, 3, generator=self.generator)
        self.photo = blocks.repeat_interleave(4, 0).repeat_interleave(4, 1)
        y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
        means2d = torch.stack([x, y], dim=-1).reshape(1, -1, 2) + 0.5
        count = means2d.shape[1]
        self.drawn = replace(nothing_drawn(), means2d=means2d, radii=torch.ones(count).int())
        self.opacities = torch.zeros(count, 1)
        self.state: dict[str, Any] = {}
        """Of the strategy."""

    def rendered(self) -> torch.Tensor:
        return self.photo + self.noise * torch.randn(self.photo.shape, generator=self.generator)

    def train_step(self, step: int, photo: torch.Tensor) -> Step:
        drawn = Step(NominalStep(step), RunStep(step), 0, the_view(), self.drawn)
        drawn.photo, drawn.static_rgb = photo, self.rendered()
        return drawn

    def find(
        self,
        photo: torch.Tensor,
        by: Thresholds | None = None,
        mask: torch.Tensor | None = None,
        unexplained: torch.Tensor | None = None,
        background: BackgroundGrade = "off",
        earlier: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Its regions; the photo is remembered. `unexplained` of it, if other photos were asked;
        regions of an `earlier` visit, if there was one."""
        five = cameras()[torch.zeros(5, dtype=torch.long)]
        config = DistractorConfig(start="residual", static_warmup=0)
        at_hand: Any = Distractors(config, SplatfactoModelConfig(), five, background=background)
        at_hand.thresholds = by or Thresholds()
        at_hand.sweep.unexplained = lambda *_: unexplained
        if earlier is not None:
            at_hand.regions[0] = earlier
        step = self.train_step(0, photo)
        step.mask = mask
        at_hand.look(step, self.opacities, self.state)
        assert step.regions is not None
        self.state[RESIDUAL_MEDIANS] = step.residual_medians
        return step.regions

    def with_an_occluder(self) -> torch.Tensor:
        photo = self.photo.clone()
        photo[10:30, 20:40] = torch.tensor([0.9, 0.1, 0.9])
        return photo
