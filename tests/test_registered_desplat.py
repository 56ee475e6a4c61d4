"""`desplat` as registered: it separates, resumes to the last bit, and so on any number of threads.

The other tests that train by `ns-train` replace its distractors by the paper's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import torch
from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackLocation

from desplat_ns.backend.numba_kernels.runtime import numba_config
from desplat_ns.training.checkpoint import checkpoint_path, load_checkpoint
from lab.bench.timing import threads
from lab.synthetic import Scene, write_scene
from tests.helpers.registered import EIGHT_VIEWS, STEPS, registered_desplat, set_up
from tests.helpers.stub_run import assert_same

pytestmark = pytest.mark.slow

SAVED = 11
"""Steps from one checkpoint to the next: one is of the warm-up, and one (step 44) of a round of
refinement of which some of the views have had their turn."""


@dataclass
class Run:
    """A run from its first step to its last, and what it was like on the way."""

    trainer: Any
    config: Any
    losses: list[dict[str, float]] = field(default_factory=list)
    static: list[int] = field(default_factory=list)
    """Static Gaussians after every step."""
    distractors: list[list[int]] = field(default_factory=list)
    """Distractors of every view after every step."""
    refined: list[tuple[int, int, int]] = field(default_factory=list)
    """Step and view of every refinement of distractors, and by how many their number changed."""

    def watch(self) -> None:
        """Write down every step."""
        model = self.trainer.pipeline.model
        finish, refine = self.trainer.train_iteration, model.layer.densifier.after_step

        def finish_and_count(step: int) -> Any:
            result = finish(step)
            self.losses.append({name: float(loss) for name, loss in model.losses.items()})
            return result

        def count(step: int) -> None:
            self.static.append(model.num_points)
            self.distractors.append(model.distractors.counts())

        def refine_and_count(view, nominal, *rest) -> None:
            refinement, before = view.refinement, len(view)
            refine(view, nominal, *rest)
            if view.refinement != refinement:
                number = model.distractors.views.index(view)
                self.refined.append((model.step, number, len(view) - before))

        self.trainer.train_iteration, model.layer.densifier.after_step = (
            finish_and_count,
            refine_and_count,
        )
        after = TrainingCallback([TrainingCallbackLocation.AFTER_TRAIN_ITERATION], count)
        self.trainer.callbacks.append(after)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return write_scene(EIGHT_VIEWS, tmp_path_factory.mktemp("eight_views"))


@pytest.fixture(scope="module")
def straight(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """All steps in one go on one thread; its checkpoints stay."""
    folder, kept = tmp_path_factory.mktemp("straight"), {"save_only_latest_checkpoint": False}
    config = registered_desplat(scene, folder, steps_per_save=SAVED, **kept)
    with threads(1):
        run = Run(set_up(config), config)
        run.watch()
        run.trainer.train()
    return run


def last_checkpoint(config: Any) -> dict[str, Any]:
    """What the last step left, but for Python's generator: training draws from its own alone, and
    beartype, which checks shapes while tests run, draws from Python's."""
    state = load_checkpoint(checkpoint_path(config.get_checkpoint_dir(), STEPS - 1))
    del state["rng"]["python"]
    return state


def test_every_loss_of_every_step_is_finite_and_they_fall(straight: Run):
    assert len(straight.losses) == STEPS
    assert all(math.isfinite(loss) for step in straight.losses for loss in step.values())
    names = {"main_loss", "opacity_prior"}
    names |= {"distractor_opacity", "static_transparency"}
    assert set(straight.losses[0]) == names
    assert set(straight.losses[-1]) == names | {"static_photometric"}
    first, last = (
        torch.tensor([step["main_loss"] for step in steps])
        for steps in (straight.losses[:8], straight.losses[-8:])
    )
    assert last.mean() < 0.8 * first.mean()


def test_the_static_set_grows_in_the_first_half_of_the_run_only(straight: Run):
    static, half = straight.static, STEPS // 2
    assert static[half] > 1.5 * static[0]
    assert len(set(static[: half + 1])) > 5
    assert len(set(static[half:])) == 1


def test_distractors_come_after_the_warmup_and_until_placing_stops(straight: Run):
    """After a fifth of the steps, and until nine tenths of them."""
    first, last = STEPS // 5, 9 * STEPS // 10
    totals = [sum(counts) for counts in straight.distractors]
    assert not any(totals[:first])
    assert all(count > 0 for count in straight.distractors[-1])
    refined = {step for step, _, _ in straight.refined}
    placed = {
        step for step in range(1, STEPS) if totals[step] != totals[step - 1] and step not in refined
    }
    assert len(placed & set(range(first, last))) > 10
    assert not placed & set(range(last, STEPS))


def test_every_view_refines_its_distractors_each_time_it_falls_due(straight: Run):
    """Five visits of eight views are 40 steps."""
    rounds = [step // 40 for step, _, _ in straight.refined]
    views = range(len(straight.distractors[0]))
    visits = sorted(zip(rounds, (view for _, view, _ in straight.refined), strict=True))
    assert visits == [(number, view) for number in (1, 2) for view in views]
    assert any(change for _, _, change in straight.refined)


def test_distractors_cover_what_stands_in_the_way_and_little_else(straight: Run, scene: Scene):
    """Of every photo, after fifteen visits: the mean opacity on occluders and beside them. How it
    is in single photos of so short a run, the last bit of a rounding decides."""
    model, manager = straight.trainer.pipeline.model.eval(), straight.trainer.pipeline.datamanager
    on, beside = [], []
    for index, frame in enumerate(scene.clutter):
        assert manager.train_image_names[index] == f"{frame.name}.png"
        camera = manager.train_dataset.cameras[index : index + 1]
        alpha = model.get_outputs_for_camera(camera)["alpha_distractor"][..., 0]
        occluded = torch.from_numpy(frame.mask)
        on.append(float(alpha[occluded].mean()))
        beside.append(float(alpha[~occluded].mean()))
    assert sum(on) > 4 * sum(beside)
    assert all(inside > 2 * outside for inside, outside in zip(on, beside, strict=True))
    assert sum(on) / len(on) > 0.3


@pytest.mark.parametrize("saved", [SAVED, 4 * SAVED])
def test_a_resumed_run_equals_one_in_one_go_to_the_last_bit(
    straight: Run, scene: Scene, tmp_path: Path, saved: int
):
    """Gaussians, moments, what refinement and placing remember, generators, order of the views."""
    resumed = registered_desplat(scene, tmp_path)
    resumed.load_checkpoint = checkpoint_path(straight.config.get_checkpoint_dir(), saved)
    with threads(1):
        trainer = set_up(resumed, seed=99)
        trainer.train()
    assert trainer._start_step == saved + 1
    assert_same(last_checkpoint(straight.config), last_checkpoint(resumed))


@pytest.mark.skipif(numba_config.NUMBA_NUM_THREADS < 2, reason="numba has one thread only")
def test_two_threads_give_the_bits_of_one(straight: Run, scene: Scene, tmp_path: Path):
    config = registered_desplat(scene, tmp_path)
    with threads(2):
        set_up(config).train()
    assert_same(last_checkpoint(straight.config), last_checkpoint(config))


def test_a_checkpoint_holds_what_refinement_and_placing_remember(straight: Run):
    """Without these the comparisons to the last bit would compare less than they say."""
    state = last_checkpoint(straight.config)
    assert {"pipeline", "optimizers", "schedulers", "rng", "sampler"} <= state.keys()
    memory = state["pipeline"]["_model._extra_state"]
    views = len(straight.distractors[0])
    of_views = state["pipeline"]["_model.distractors._extra_state"]
    assert all(view["refinement"] > 0 for view in of_views)
    names = {"grad2d", "count", "usual_residual", "times_seen"}
    assert names <= memory["static_strategy"].keys()
    assert memory["static_strategy"]["visits"] > views
    assert sorted(memory["photos"]) == list(range(views))
    assert sorted(memory["regions"]) == list(range(views))
    for view in of_views:
        assert view["moments"].keys() == {"means", "scales", "quats", "rgbs", "opacities"}
        assert view["state"].keys() >= {"grad2d", "count"}
