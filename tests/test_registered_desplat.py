"""`desplat` as registered: it separates, and resumes to the last bit on any number of threads.

The other tests that train by `ns-train` replace its distractors by the paper's.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import torch

from desplat_ns.backend.numba_kernels.runtime import numba_config
from desplat_ns.core.checkpoint import checkpoint_path
from lab.bench.timing import threads
from lab.synthetic import Scene
from tests.helpers.registered import STEPS, last_state, registered_desplat, set_up
from tests.helpers.stub_run import assert_same

pytestmark = pytest.mark.slow

SAVED = 44
"""Steps from one checkpoint to the next: the first is of a round of refinement of which some of the
views have had their turn."""

JUDGED = slice(-1)
"""Photos in which something is found. In the last one of the row the thing stands where fewer than
two others look at 95% of the depths: nobody knows."""


@dataclass
class Run:
    """A run, and what it was like after every step."""

    trainer: Any
    config: Any
    losses: list[dict[str, float]] = field(default_factory=list)
    static: list[int] = field(default_factory=list)
    """Number of static Gaussians."""
    distractors: list[int] = field(default_factory=list)
    """Number of distractors of all views."""

    def train(self) -> None:
        """All steps."""
        model, iteration = self.trainer.pipeline.model, self.trainer.train_iteration

        def watched(step: int) -> Any:
            result = iteration(step)
            losses = model.train_step.losses
            self.losses.append({name: float(loss) for name, loss in losses.items()})
            self.static.append(model.num_points)
            self.distractors.append(sum(model.distractors.counts()))
            return result

        self.trainer.train_iteration = watched
        self.trainer.train()


@pytest.fixture(scope="module")
def straight(eight_views: Scene, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """All steps in one go on one thread; its checkpoints stay."""
    folder, kept = tmp_path_factory.mktemp("straight"), {"save_only_latest_checkpoint": False}
    config = registered_desplat(eight_views, folder, steps_per_save=SAVED, **kept)
    with threads(1):
        run = Run(set_up(config), config)
        run.train()
    return run


def test_every_loss_of_every_step_is_finite_and_they_fall(straight: Run):
    assert len(straight.losses) == STEPS
    assert all(math.isfinite(loss) for step in straight.losses for loss in step.values())
    main = torch.tensor([step["main_loss"] for step in straight.losses])
    assert main[-8:].mean() < 0.8 * main[:8].mean()


def test_both_sets_grow_when_it_is_their_time(straight: Run):
    """The static one in the first half; distractors after a fifth of the steps."""
    static, half, warmup = straight.static, STEPS // 2, STEPS // 5
    assert static[half] > 1.5 * static[0] and len(set(static[half:])) == 1
    assert not any(straight.distractors[:warmup])
    assert all(straight.trainer.pipeline.model.distractors.counts()[JUDGED])


def test_distractors_cover_what_stands_in_the_way_and_little_else(straight: Run, eight_views):
    """Of every photo, after fifteen visits: the mean opacity on occluders and beside them. How it
    is in single photos of so short a run, the last bit of a rounding decides."""
    model, manager = straight.trainer.pipeline.model.eval(), straight.trainer.pipeline.datamanager
    on, beside = [], []
    for index, frame in enumerate(eight_views.clutter):
        assert manager.train_image_names[index] == f"{frame.name}.png"
        camera = manager.train_dataset.cameras[index : index + 1]
        alpha = model.get_outputs_for_camera(camera)["alpha_distractor"][..., 0]
        occluded = torch.from_numpy(frame.mask)
        on.append(float(alpha[occluded].mean()))
        beside.append(float(alpha[~occluded].mean()))
    assert sum(on) > 4 * sum(beside)
    pairs = list(zip(on, beside, strict=True))[JUDGED]
    assert all(inside > 2 * outside for inside, outside in pairs)
    assert sum(on) / len(on) > 0.3


def test_a_run_resumed_on_two_threads_equals_one_in_one_go_on_one_to_the_last_bit(
    straight: Run, eight_views: Scene, tmp_path: Path
):
    """Gaussians, moments, what refinement and placing remember, generators, order of the views."""
    resumed = registered_desplat(eight_views, tmp_path)
    resumed.load_checkpoint = checkpoint_path(straight.config.get_checkpoint_dir(), SAVED)
    with threads(min(2, numba_config.NUMBA_NUM_THREADS)):
        trainer = set_up(resumed, seed=99)
        trainer.train()
    assert trainer._start_step == SAVED + 1
    state = last_state(straight.config)
    assert_same(state, last_state(resumed))
    memory = state["pipeline"]["_model._extra_state"]  # what is compared is all there
    assert memory["static_strategy"]["usual_residual"].any()
    memory = state["pipeline"]["_model.distractors._extra_state"]
    assert memory["regions"] and memory["photos"]
    assert all(view["refinement"] > 0 and view["moments"] for view in memory["views"][JUDGED])
