"""When a photo is compared with the static scene."""

from types import SimpleNamespace
from typing import Any

import pytest
import torch
from nerfstudio.data.datamanagers.full_images_datamanager import (
    FullImageDatamanager,
    FullImageDatamanagerConfig,
)

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.core.schedule import NominalStep, RunStep, Schedule
from desplat_ns.distractors import distractors as module
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.distractors import Distractors, apply_mask
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.separation import decide
from desplat_ns.separation.decide import StaticView
from desplat_ns.step import Step
from tests.helpers.small_model import make_model
from tests.helpers.well_known_scene import WellKnownScene, cameras, nothing_drawn, the_view


@pytest.mark.usefixtures("unchecked_types")
@pytest.mark.parametrize("steps", [300, 3_000, 30_000])
def test_after_the_warm_up_a_photo_is_looked_at_at_once_and_then_in_every_third_visit(steps):
    """40 photos in the order of nerfstudio; the run goes on from a checkpoint in the middle."""
    schedule = Schedule(steps / 30_000)
    run = DeSplatModelConfig(
        schedule_scale=schedule.scale,
        distractors=DistractorConfig(start="residual", static_warmup=None),
    ).for_run(40)
    cams = cameras()[torch.zeros(40, dtype=torch.long)]
    manager: Any = SimpleNamespace(train_dataset=range(40), config=FullImageDatamanagerConfig())
    drawn = the_view(), nothing_drawn()
    at_hand, unseen, visits = None, [], {index: [] for index in range(40)}
    for step in map(RunStep, range(steps)):
        if at_hand is None or step == steps // 2:
            kept = {} if at_hand is None else at_hand.regions
            at_hand = Distractors(run.distractors, run, cams)
            at_hand.regions = kept
        unseen = unseen or FullImageDatamanager.sample_train_cameras(manager)
        index, nominal = unseen.pop(0), schedule.nominal(step)
        looks = at_hand.looks(Step(nominal, step, index, *drawn))
        if nominal >= run.distractors.warmup:
            visits[index].append(looks)
            at_hand.regions[index] = torch.ones(1, 1, dtype=torch.bool)
        assert looks or nominal >= run.distractors.warmup
    for looked in visits.values():
        first, *gaps = torch.tensor(looked).nonzero()[:, 0].diff(prepend=torch.tensor([0])).tolist()
        assert first == 0 and len(gaps) >= len(looked) // 3 - 1
        assert all(1 <= gap <= 3 for gap in gaps[:1]) and all(gap == 3 for gap in gaps[1:])


def test_what_the_sweep_keeps_does_not_depend_on_the_static_scene():
    """Not in masked pixels either, and of the first visit alone."""
    config = DistractorConfig(start="residual", static_warmup=2)
    model = make_model(distractors=config)
    view = View(torch.eye(4), torch.eye(3), 24, 20)
    photo, mask = torch.rand(20, 24, 3), torch.ones(20, 24, 1, dtype=torch.bool)
    mask[5:9] = False

    def kept(number: int, value: float) -> Any:
        static, radii = torch.full((20, 24, 3), value), torch.ones(30, dtype=torch.int32)
        drawn = Rendering(static, static[..., :1], None, torch.rand(1, 30, 2), radii)
        step = Step(NominalStep(number), RunStep(number), 1, view, drawn)
        step.photo, step.static_rgb, step.mask = photo, static, mask
        model.distractors.look(step, torch.zeros(30, 1), {})
        return step.sweep_photo

    first = kept(0, 0.0)
    assert torch.equal(first, kept(0, 1.0))
    assert (first[5:9, :, 3] == 0).all()
    model.distractors.sweep.keep(1, first)
    assert kept(1, 1.0) is None


def test_a_background_that_the_user_chose_is_scene_and_a_random_one_is_not(monkeypatch):
    scene, seen = WellKnownScene(), []

    def compare(photo: torch.Tensor, static: StaticView, *rest: Any) -> Any:
        seen.append(static.behind)
        return decide.compare(photo, static, *rest)

    monkeypatch.setattr(module, "compare", compare)
    config, cams = DistractorConfig(start="residual"), cameras()[torch.zeros(5, dtype=torch.long)]
    for color in ("random", "white"):
        static = DeSplatModelConfig(background_color=color)
        at_hand = Distractors(config, static, cams)
        step = scene.train_step(0, scene.photo)
        step.behind = torch.ones(3)
        at_hand.look(step, scene.opacities, scene.state)
    assert seen[0] is not None and seen[1] is None


def test_a_cell_counts_if_half_of_its_pixels_do():
    mask = torch.ones(160, 200, 1, dtype=torch.bool)  # cells of 2 x 2 pixels
    mask[:2, :4] = torch.tensor([[1, 0, 0, 1], [1, 0, 0, 0]], dtype=torch.bool)[..., None]
    photo = torch.rand(160, 200, 3, generator=torch.Generator().manual_seed(0))
    seen, counted = apply_mask(photo, 1 - photo, mask)
    assert torch.equal(seen, photo.where(mask, 1 - photo))
    assert counted.shape == (80, 100)
    assert counted[0, :3].tolist() == [True, False, True]
    assert counted.sum() == counted.numel() - 1
