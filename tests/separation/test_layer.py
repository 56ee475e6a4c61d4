"""When a photo is compared with the static scene: always, until nothing was found for a while."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
import torch

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.model import DeSplatModel
from desplat_ns.separation import layer
from desplat_ns.separation.layer import QUIET_VISITS, DistractorLayer
from desplat_ns.separation.regions import Comparison
from tests.helpers.small_model import NUM_VIEWS, Trainer, make_model
from tests.helpers.well_known_scene import WellKnownScene, nothing_drawn


def a_model(**changes: Any) -> DeSplatModel:
    values: dict[str, Any] = {"start": "residual", "static_warmup": 2, "stop_placing_at": 1000}
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


def test_after_a_round_without_a_region_every_tenth_visit_is_looked_at(monkeypatch):
    """Three views, a warm-up of two steps."""
    looked_at = looks(monkeypatch, a_model(), range(30))
    assert looked_at == [2, 3, 4, 4 + QUIET_VISITS, 4 + 2 * QUIET_VISITS]


def test_a_region_wakes_the_search(monkeypatch):
    first = 4 + QUIET_VISITS
    looked_at = looks(monkeypatch, a_model(), range(first + 6), found_at=first)
    assert looked_at == [2, 3, 4, first, first + 1, first + 2, first + 3]


def test_a_visit_that_is_not_looked_at_teaches_the_statistics_nothing(monkeypatch):
    model = a_model()
    looked_at = looks(monkeypatch, model, range(12))
    assert model.memory.number("visits") == 2 + len(looked_at) == 5


def test_a_checkpoint_holds_how_long_nothing_was_found(monkeypatch):
    model = a_model()
    looks(monkeypatch, model, range(9))
    fresh = a_model()
    fresh.load_state_dict(model.state_dict())
    assert looks(monkeypatch, fresh, range(9, 20)) == [4 + QUIET_VISITS]


def test_a_checkpoint_holds_the_photos_that_are_asked(monkeypatch):
    model = a_model(static_warmup=3)
    looks(monkeypatch, model, range(3))
    fresh = a_model(static_warmup=3)
    fresh.load_state_dict(model.state_dict())
    assert model.layer is not None and fresh.layer is not None
    photos, restored = model.layer.witnesses.state(), fresh.layer.witnesses.state()
    assert list(photos) == list(restored) == [0, 1, 2]
    assert all(torch.equal(photos[index], restored[index]) for index in photos)


def a_quiet_layer() -> DistractorLayer:
    quiet = a_model().layer
    assert quiet is not None
    quiet.visits = {"without_region": NUM_VIEWS, "not_looked_at": 3}
    return quiet


def test_a_photo_with_distractors_is_always_looked_at():
    scene = WellKnownScene()
    step = scene.train_step(100, scene.photo)
    assert not a_quiet_layer()._looks(step)
    step.distractors = nothing_drawn()
    assert a_quiet_layer()._looks(step)
