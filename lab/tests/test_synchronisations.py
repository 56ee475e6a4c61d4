"""A training step seldom waits for a GPU; what would make it wait is counted on a CPU."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from desplat_ns.gaussians.strategy import StaticStrategy
from desplat_ns.separation import regions
from lab.synchronisations import Synchronisations, synchronisations_of
from lab.synthetic import Scene, write_scene
from tests.helpers.registered import EIGHT_VIEWS, registered_desplat, set_up
from tests.helpers.splatfacto import splatfacto_trainer

VALUES = torch.arange(6.0)
MASK = VALUES > 2

MOST = 12
"""In a step of `desplat` that refines nothing: what was asked for."""

OWN = {"separation": 2, "rendering": 1, "training": 1}
"""Of them those that no other package causes, by room: the excess of residuals, and which
distractors stay and where some are missing; the size of the photo; whether the step is sound."""

SAMPLED = range(25, 60)
"""Steps of a run of 120 in which there are distractors, and gradients of both sets are sampled."""


@pytest.mark.parametrize(
    "waits",
    [
        lambda: VALUES[2].item(),
        lambda: float(VALUES.sum()),
        lambda: bool(MASK.any()),
        lambda: VALUES.tolist(),
        lambda: VALUES.cpu(),
        lambda: VALUES[MASK],
        lambda: VALUES.clone().__setitem__(MASK, torch.zeros(3)),
        lambda: MASK.nonzero(),
        lambda: torch.where(MASK),
        lambda: VALUES.masked_select(MASK),
        lambda: VALUES.unique(),
        lambda: VALUES.repeat_interleave(torch.tensor([1, 2, 3, 4, 5, 6])),
        lambda: torch.equal(VALUES, MASK),
        lambda: VALUES.new_tensor([1.0]),
    ],
)
def test_what_a_host_waits_for_is_counted(waits: Callable[[], object]):
    with Synchronisations() as counted:
        waits()
    assert counted.total >= 1


@pytest.mark.parametrize(
    "goes_on",
    [
        lambda: VALUES[torch.zeros(2, dtype=torch.long)],
        lambda: torch.where(MASK, VALUES, 0.0) + VALUES.masked_fill(MASK, 1.0),
        lambda: VALUES.quantile(0.25) + VALUES.nanquantile(0.5),
        lambda: VALUES.repeat_interleave(VALUES.long(), output_size=15),
        lambda: torch.zeros(3, 4).index_add_(0, torch.zeros(3, dtype=torch.long), torch.ones(3, 4)),
        lambda: VALUES.numpy(),
    ],
)
def test_what_a_device_does_in_its_turn_is_not(goes_on: Callable[[], object]):
    with Synchronisations() as counted:
        goes_on()
    assert counted.report() == ""


def test_it_is_said_what_happens_where_as_often_as_it_does():
    with Synchronisations() as counted:
        for _ in range(3):
            VALUES.sum().item()
    (place,) = counted.counts
    assert place.startswith(f"a number is read in {__name__}.test_it_is_said")
    assert counted.report() == f"3 x {place}"
    assert counted.total == 3


def test_backward_passes_count_and_what_is_left_out_does_not():
    class Reading(torch.autograd.Function):
        @staticmethod
        def forward(ctx, value):  # type: ignore[override]
            return value.clone()

        @staticmethod
        def backward(ctx, gradient):  # type: ignore[override]
            return gradient * gradient.sum().item()

    def step() -> None:
        Reading.apply(VALUES.clone().requires_grad_()).sum().backward()  # type: ignore[attr-defined]

    with Synchronisations() as counted:
        step()
    assert counted.total == 1
    with Synchronisations(left_out=(__name__,)) as counted:
        step()
    assert counted.total == 0


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return write_scene(EIGHT_VIEWS, tmp_path_factory.mktemp("eight_views"))


def own(counted: Synchronisations) -> dict[str, int]:
    """How many the package causes, by room."""
    rooms: dict[str, int] = {}
    for place, count in counted.counts.items():
        package, room = place.split(" in ")[-1].split(".")[:2]
        if package == "desplat_ns":
            rooms[room] = rooms.get(room, 0) + count
    return rooms


@pytest.mark.slow
def test_a_step_of_desplat_that_refines_nothing_waits_seldom(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """With distractors, the search for regions to its end, and the gradients of both sets sampled.
    On a CPU the search ends where nothing is strong enough: here everything is."""
    monkeypatch.setattr(regions, "MAX_PEAK", -1.0)
    trainer = set_up(registered_desplat(scene, tmp_path))
    model, calm = trainer.pipeline.model, 0
    for step in range(SAMPLED.stop):
        refinements = [view.refinement for view in model.distractors.views]
        counted = synchronisations_of(trainer, step)
        refined = model.strategy_state[StaticStrategy.SAMPLED] == 0
        reset = model.nominal_step % model.strategy.reset_every == 0
        refined |= refinements != [view.refinement for view in model.distractors.views]
        if refined or reset or step not in SAMPLED:
            continue
        calm += 1
        assert counted.total <= MOST, counted.report()
        assert own(counted) == OWN, counted.report()
    assert calm > 10
    assert model.distractors.total > 100


@pytest.mark.slow
def test_splatfactos_own_step_waits_more_often(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Three times in the sample; size, axes, and constants are sent or fetched."""
    trainer = splatfacto_trainer(scene, tmp_path, monkeypatch)
    synchronisations_of(trainer, 0)  # resets the opacities
    assert [synchronisations_of(trainer, step).total for step in range(1, 4)] == [11] * 3
