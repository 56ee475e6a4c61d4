"""Training guards: what is not finite changes nothing, is named, and ends a hopeless run."""

import copy
from typing import Any

import pytest
import torch

from desplat_ns.core.checkpoint import checkpoints_in, load_checkpoint
from desplat_ns.core.errors import TrainingError
from desplat_ns.core.optimizers import FusedAdamConfig
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.training import step_guard
from desplat_ns.training.step_guard import GuardedOptimizers
from tests.helpers.small_model import NUM_VIEWS, Trainer, make_model
from tests.helpers.stub_run import assert_same, resumed, set_up, train
from tests.helpers.stub_run import config as config  # a fixture

NAN, INF = float("nan"), float("inf")


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return " ".join(capsys.readouterr().out.split())


class GuardedTrainer(Trainer):
    """With the guard in nerfstudio's order of things in a step."""

    def __init__(self, model: Any):
        super().__init__(model)
        groups = {name: params for name, params in model.get_param_groups().items() if params}
        options = {
            name: {"optimizer": FusedAdamConfig(lr=adam.param_groups[0]["lr"]), "scheduler": None}
            for name, adam in self.optimizers.items()
        }
        self.spoil = lambda: None
        self.guarded = GuardedOptimizers(options, groups, lambda: model)
        self.optimizers = self.guarded.optimizers
        self.scaler = torch.cuda.amp.GradScaler(enabled=False)

    def update(self) -> None:
        self.spoil()
        self.guarded.optimizer_scaler_step_some(self.scaler, list(self.optimizers))

    def visit(self, step: int) -> None:
        self.step(step, step % NUM_VIEWS)

    def state(self) -> dict[str, Any]:
        """All that a checkpoint holds of the model and its optimizers, moments included."""
        adams = {name: adam.state_dict() for name, adam in self.optimizers.items()}
        return copy.deepcopy({"model": self.model.state_dict(), "adam": adams})


def a_model() -> Any:
    """Both sets are refined every third step, with all that is remembered."""
    distractors = DistractorConfig(start="residual", static_alone=True, static_warmup=2)
    steps: dict[str, Any] = {"warmup_length": 2, "refine_every": 3, "densify_grad_thresh": 1e-9}
    points = torch.rand(40, 3, generator=torch.Generator().manual_seed(2)) - 0.5
    model = make_model(points, distractors=distractors, **steps)
    model.distractors.densifier.every = 3
    return model


@pytest.mark.slow
def test_a_bad_gradient_changes_no_bit_and_its_photo_is_named_once(capsys):
    """With distractors as in the paper; both sets are refined every third step."""
    distractors = DistractorConfig(per_view=20, refine_visits=1)
    model = make_model(distractors=distractors, warmup_length=2, refine_every=3)
    trainer = GuardedTrainer(model)
    trainer.model.names = ["a.jpg", "b.jpg", "c.jpg"]
    for step in range(8):
        trainer.visit(step)
    before = trainer.state()
    places = [("means", 0, INF), ("features_rest", 0, 1e30)]  # whose square is infinite
    places += [("distractors", 0, -INF), ("distractors", 3, NAN)]

    def spoil(name: str, group: int, value: float) -> None:
        optimizers = trainer.optimizers | trainer.model.view_optimizers()
        parameters = optimizers[name].param_groups[group]["params"]
        grad = next(p.grad for p in parameters if p.grad is not None)
        grad.view(-1)[-1] = value

    for place in places:
        trainer.spoil = lambda place=place: spoil(*place)
        trainer.visit(9)  # a refinement would be due
        assert_same(before, trainer.state())
    assert said(capsys).count("a.jpg") == 1
    assert trainer.guarded.skipped_in_a_row == len(places)
    trainer.spoil = lambda: None
    trainer.visit(10)
    assert trainer.guarded.skipped_in_a_row == 0
    with pytest.raises(AssertionError):  # and the one after that trains
        assert_same(before, trainer.state())


@pytest.mark.parametrize("step", [0, 1, 5])
def test_a_photo_that_is_not_finite_leaves_nothing_behind(step):
    """Residuals are remembered before the backward pass, and would be NaN from then on."""
    trainer = GuardedTrainer(a_model())
    for earlier in range(step):
        trainer.visit(earlier)
    before = trainer.state()
    sound, trainer.photo = trainer.photo, trainer.photo.clone()
    trainer.photo[3, 4, 1] = INF if step == 1 else NAN
    trainer.visit(step)
    assert trainer.guarded.skipped_in_a_row == 1
    assert_same(before, trainer.state())
    trainer.photo = sound
    trainer.visit(step + 1)
    assert torch.isfinite(trainer.model.strategy_state["usual_residual"]).all()


def spoiled(config: Any, steps: Any, value: float = NAN) -> Any:
    """A trainer on the stub whose loss is not finite at `steps`."""
    trainer = set_up(config)
    honest = trainer.pipeline.get_train_loss_dict

    def get_train_loss_dict(step: int) -> Any:
        outputs, losses, metrics = honest(step)
        factor = value if step in steps else 1.0
        return outputs, {name: loss * factor for name, loss in losses.items()}, metrics

    trainer.pipeline.get_train_loss_dict = get_train_loss_dict
    return trainer


def test_after_too_many_it_saves_the_sound_state_and_says_why(config, monkeypatch):
    monkeypatch.setattr(step_guard, "MOST_SKIPPED", 2)
    trainer = spoiled(config, {3, 6, 7}, INF)
    states = {}

    def remember(step: int) -> None:
        states[step] = copy.deepcopy(trainer._state(step))

    trainer.pipeline.at_step = remember
    with pytest.raises(TrainingError, match=r"step 7.* a\.jpg.*--load-checkpoint"):
        trainer.train()
    path = checkpoints_in(config.get_checkpoint_dir())[-1]
    assert path.name == "step-000000007.ckpt"
    saved = load_checkpoint(path)
    began, adams = states[6], saved["optimizers"]  # the state with which step 6 began
    assert_same(dict(began["pipeline"]), dict(saved["pipeline"]))
    for name, adam in adams.items():  # rates follow the count of steps
        assert_same(began["optimizers"][name]["state"], adam["state"])
    second = resumed(config)
    assert train(second).pipeline.trained == [8, 9, 10, 11]
