"""When a photo is compared with the static scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
import torch

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.model import DeSplatModel
from desplat_ns.separation import layer
from desplat_ns.separation.regions import Comparison
from tests.helpers.small_model import NUM_VIEWS, Trainer, make_model


def a_model(**changes: Any) -> DeSplatModel:
    values: dict[str, Any] = {"start": "residual", "static_warmup": 2}
    return make_model(distractors=DistractorConfig(per_view=20, **values | changes))


def looks(
    monkeypatch: pytest.MonkeyPatch, model: DeSplatModel, steps: Sequence[int], found_at: int = -1
) -> list[int]:
    """The steps at which regions were looked for; there is one at `found_at` alone."""
    looked_at, trainer = [], Trainer(model)

    def find(comparison: Comparison, *_: Any) -> torch.Tensor:
        looked_at.append(model.step)
        return torch.full(comparison.excess.values.shape, model.step == found_at)

    monkeypatch.setattr(layer, "find_regions", find)
    for step in steps:
        trainer.step(step, step % NUM_VIEWS)
    return looked_at


def test_photos_are_looked_at_after_the_warm_up_and_then_in_every_third_round(monkeypatch):
    """Three views, a warm-up of two steps."""
    model = a_model()
    assert looks(monkeypatch, model, range(21)) == [2, 3, 4, 9, 10, 11, 18, 19, 20]


def test_regions_stay_until_the_next_look_and_in_a_checkpoint(monkeypatch):
    model = a_model()
    looks(monkeypatch, model, range(9), found_at=4)
    fresh = a_model()
    fresh.load_state_dict(model.state_dict())
    assert model.layer is not None and fresh.layer is not None
    assert list(fresh.layer.sweep.state()) == list(model.layer.sweep.state()) == [0, 1, 2]
    for layer_at_hand in (model.layer, fresh.layer):
        found = {index: regions.all() for index, regions in layer_at_hand.regions.items()}
        assert found == {2: False, 0: False, 1: True}


def test_what_the_sweep_keeps_does_not_depend_on_the_static_scene():
    """Not in masked pixels either, and of the first visit alone."""
    model = a_model()
    assert model.layer is not None
    view = View(torch.eye(4), torch.eye(3), 24, 20)
    photo, mask = torch.rand(20, 24, 3), torch.ones(20, 24, 1, dtype=torch.bool)
    mask[5:9] = False
    kept = []
    for value in (0.0, 1.0):
        static = torch.full((20, 24, 3), value)
        radii = torch.ones(30, dtype=torch.int32)
        drawn = Rendering(static, static[..., :1], None, torch.rand(1, 30, 2), radii)
        step = layer.TrainStep(0, 1, view, drawn)
        model.layer.look(step, photo, static, mask, torch.zeros(30, 1), {})
        kept.append(step.sweep_photo)
    assert torch.equal(*kept)
    assert (kept[0][5:9, :, 3] == 0).all()
    model.layer.sweep.keep(1, kept[0])
    step = layer.TrainStep(1, 1, view, drawn)
    model.layer.look(step, photo, static, mask, torch.zeros(30, 1), {})
    assert step.sweep_photo is None
