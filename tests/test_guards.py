"""Training guards: what is not finite changes nothing, is named, and ends a hopeless run."""

import copy
import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from desplat_ns.training.culled import TOO_WIDE, culled_always
from nerfstudio.engine.optimizers import Optimizers
from test_model import NUM_VIEWS, camera, make_model
from test_trainer import assert_same, resumed, set_up, train
from test_trainer import config as config  # a fixture
from torch import Tensor

from desplat_ns.errors import ConfigError, TrainingError
from desplat_ns.gaussians.distractors import DistractorConfig
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.training.checkpoint_files import checkpoints_in, load_checkpoint
from desplat_ns.training.optimizers import FusedAdamConfig
from desplat_ns.training.step_guard import (
    GuardedOptimizers,
    StepGuard,
    check_parameters,
    find_fault,
)

NAN, INF = float("nan"), float("inf")


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return " ".join(capsys.readouterr().out.split())


# --- what is found ---------------------------------------------------------------------------


@pytest.mark.parametrize("value", [NAN, INF, -INF, 1e30])
def test_one_value_among_many_is_found_and_its_group_named(value):
    gradients = {"means": [torch.ones(50, 3)], "scales": [torch.ones(7, 3), torch.ones(70, 3)]}
    assert find_fault({"main": torch.tensor(1.0)}, gradients) is None
    gradients["scales"][1][41, 2] = value
    fault = find_fault({"main": torch.tensor(1.0)}, gradients)
    assert str(fault) == "the gradient of scales"


@pytest.mark.parametrize("value", [NAN, INF])
def test_the_term_of_the_loss_is_named(value):
    losses = {"main_loss": torch.tensor(1.0), "distractor_opacity": torch.tensor(value)}
    assert str(find_fault(losses, {})) == "the loss (distractor_opacity)"


def test_sound_gradients_whose_squares_only_overflow_together_are_no_fault():
    each = torch.full((1,), 1.5e19)  # squared 2.3e38, and float32 ends at 3.4e38
    assert find_fault({}, {"means": [each], "scales": [each]}) is None


def test_a_run_that_may_skip_nothing_is_refused():
    with pytest.raises(ConfigError, match="--max-skipped-steps is 0"):
        StepGuard(0)


# --- a step of the model ---------------------------------------------------------------------


class GuardedTrainer:
    """nerfstudio's order of things in a step, around the model of test_model.py."""

    def __init__(self, model: DeSplatModel, max_skipped: int = 10):
        self.model, self.step_at_hand = model, 0
        self.scaler = torch.amp.GradScaler("cpu", enabled=False)
        groups = {name: params for name, params in model.get_param_groups().items() if params}
        rates = {name: 1e-4 if "means" in name else 1e-2 for name in groups}
        options = {
            name: {"optimizer": FusedAdamConfig(lr=rate), "scheduler": None}
            for name, rate in rates.items()
        }
        self.guard = StepGuard(max_skipped)
        self.optimizers = GuardedOptimizers(options, groups, self._may_step)
        self.photo = torch.rand(20, 24, 3, generator=torch.Generator().manual_seed(1))

    def _may_step(self, scaler: Any) -> bool:
        return self.guard.is_sound(self.step_at_hand, self.model, self.optimizers, scaler)

    def step(self, step: int, spoil: Any = None, photo: Tensor | None = None) -> None:
        model, self.step_at_hand = self.model, step
        model.train()
        model.step, model.optimizers = step, self.optimizers.optimizers
        self.optimizers.zero_grad_all()
        outputs = model(camera(step % NUM_VIEWS))
        batch = {"image": self.photo if photo is None else photo}
        losses = model.get_loss_dict(outputs, batch)
        torch.stack(list(losses.values())).sum().backward()
        if spoil is not None:
            spoil()
        self.optimizers.optimizer_scaler_step_some(self.scaler, list(self.optimizers.optimizers))
        model.step_post_backward(step)

    def state(self) -> dict[str, Any]:
        """All that a checkpoint holds of the model and its optimizers, moments included."""
        adams = {name: one.state_dict() for name, one in self.optimizers.optimizers.items()}
        placing = self.model.placement._seen
        return copy.deepcopy({"model": self.model.state_dict(), "adam": adams, "seen": placing})


def a_model() -> DeSplatModel:
    """Refined every third step, distractors every second visit, with all that is remembered."""
    distractors = DistractorConfig(
        per_view=20, start="residual", static_alone=True, static_warmup=2, refine_every=2
    )
    steps: dict[str, Any] = {"warmup_length": 2, "refine_every": 3, "densify_grad_thresh": 1e-9}
    points = torch.rand(40, 3, generator=torch.Generator().manual_seed(2)) - 0.5
    return make_model(points, distractors=distractors, **steps)


def everywhere() -> DeSplatModel:
    distractors = DistractorConfig(per_view=20, refine_every=2)
    return make_model(distractors=distractors, warmup_length=2, refine_every=3)


def test_a_bad_gradient_changes_no_bit_and_its_group_and_photo_are_named(capsys):
    trainer = GuardedTrainer(everywhere(), max_skipped=1000)
    trainer.model.names = ["a.jpg", "b.jpg", "c.jpg"]
    for step in range(8):
        trainer.step(step)
    before = trainer.state()
    optimizers = trainer.optimizers.optimizers
    assert len(optimizers) == 11

    def spoil(group: str) -> None:
        parameters = optimizers[group].param_groups[0]["params"]
        grad = next(p.grad for p in parameters if p.grad is not None)
        grad.view(-1)[-1] = INF if "means" in group else NAN

    for group in optimizers:
        trainer.step(9, lambda group=group: spoil(group))  # a refinement would be due
        assert_same(before, trainer.state())
        expected = f"At step 9, in the photo a.jpg: the gradient of {group} is not finite"
        assert expected in said(capsys)
    trainer.step(10)
    assert trainer.guard.skipped == len(optimizers)
    with pytest.raises(AssertionError):  # and the one after that trains
        assert_same(before, trainer.state())


@pytest.mark.parametrize("step", [0, 1, 9])
def test_a_photo_that_is_not_finite_leaves_nothing_behind(step, capsys):
    """Residuals are remembered before the backward pass, and would be NaN from then on."""
    trainer = GuardedTrainer(a_model())
    for earlier in range(step):
        trainer.step(earlier)
    before = trainer.state()
    photo = trainer.photo.clone()
    photo[3, 4, 1] = INF if step == 1 else NAN
    trainer.step(step, photo=photo)
    assert_same(before, trainer.state())
    assert "the loss (main_loss" in said(capsys)
    trainer.step(step + 1)
    assert torch.isfinite(trainer.model.strategy_state["usual_residual"]).all()


def test_two_runs_that_differ_in_a_skipped_step_stay_the_same():
    """A skipped step of a view is a view that was not visited."""
    ends = []
    for bad in (False, True):
        trainer = GuardedTrainer(a_model())
        for step in range(12):
            if step == 7 and not bad:
                continue
            trainer.step(step, photo=torch.full_like(trainer.photo, NAN) if step == 7 else None)
        ends.append(trainer.state())
    assert_same(*ends)


# --- a run -----------------------------------------------------------------------------------


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


def test_a_run_skips_a_bad_step_and_goes_on(config, capsys):
    trainer = spoiled(config, {4})
    trainer.train()
    assert trainer.pipeline.trained == list(range(12))
    assert "At step 4: the gradient of means, scales is not finite" in said(capsys)
    last = load_checkpoint(config.get_checkpoint_dir() / "step-000000011.ckpt")
    assert last["optimizers"]["means"]["state"][0]["step"] == 11
    assert torch.isfinite(trainer.pipeline.groups["means"]).all()


def test_after_the_stated_number_it_saves_the_sound_state_and_says_why(config):
    config.max_skipped_steps = 2
    trainer = spoiled(config, {3, 7, 8}, INF)
    states = {}

    def remember(step: int) -> None:
        states[step] = copy.deepcopy(trainer._state(step))

    trainer.pipeline.at_step = remember
    with pytest.raises(TrainingError, match=r"2 steps were skipped.*At step 7.*--load-checkpoint"):
        trainer.train()
    path = checkpoints_in(config.get_checkpoint_dir())[-1]
    assert path.name == "step-000000007.ckpt"
    saved = load_checkpoint(path)
    began, adams = states[7], saved["optimizers"]  # the state with which step 7 began
    assert_same(dict(began["pipeline"]), dict(saved["pipeline"]))
    for name, adam in adams.items():  # rates follow the count of steps
        assert_same(began["optimizers"][name]["state"], adam["state"])
    second = resumed(config)
    assert train(second).pipeline.trained == [8, 9, 10, 11]


def test_parameters_that_are_not_finite_never_replace_a_good_checkpoint(config):
    config.save_only_latest_checkpoint = True
    trainer = set_up(config)

    def break_at_9(step: int) -> None:
        if step == 9:
            trainer.optimizers.optimizers["scales"].param_groups[0]["lr"] = INF

    trainer.pipeline.at_step = break_at_9
    trainer.pipeline.get_train_loss_dict = without_scales_after_9(trainer)
    with pytest.raises(TrainingError, match=r"parameters scales are not finite.*untouched: go on"):
        trainer.train()
    (good,) = checkpoints_in(config.get_checkpoint_dir())
    assert good.name == "step-000000005.ckpt"
    assert torch.isfinite(load_checkpoint(good)["pipeline"]["groups.scales"]).all()


def without_scales_after_9(trainer: Any) -> Any:
    """Losses stay finite although a parameter is not: nothing but the save can notice."""
    honest = trainer.pipeline.get_train_loss_dict

    def get_train_loss_dict(step: int) -> Any:
        if step <= 9:
            return honest(step)
        trainer.pipeline.trained.append(step)
        return {}, {"loss": (trainer.pipeline.groups["means"] ** 2).sum()}, {}

    return get_train_loss_dict


# --- culled Gaussians ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [("means", NAN), ("means", 1e30), ("scales", 1e30), ("quats", 0.0), ("features_dc", 1e25)],
)
def test_gaussians_that_no_view_shows_are_counted_logged_and_told_once(name, value, capsys):
    model = everywhere()
    trainer = GuardedTrainer(model)
    trainer.step(1)
    model.gauss_params[name].data[:2] = value
    assert model.culled_static() == 2
    model._count_culled(100)
    model._count_culled(200)
    outputs = model(camera(0))
    metrics = model.get_metrics_dict(outputs, {"image": trainer.photo})
    assert metrics["culled_static"] == 2
    assert metrics["culled_distractors"] == 0
    assert said(capsys).count("2 static Gaussians and 0 distractors") == 1


def test_a_distractor_that_is_culled_is_counted():
    model = everywhere()
    assert model.distractors is not None
    model.distractors.params_of(1)["means"].data[3] = NAN
    assert (model.culled_static(), model.culled_distractors()) == (0, 1)


def test_a_learning_rate_spike_ends_the_run_with_its_reason():
    trainer = GuardedTrainer(everywhere())
    model = trainer.model
    trainer.optimizers.optimizers["means"].param_groups[0]["lr"] = 1e30
    with pytest.raises(TrainingError, match=r"static Gaussians hold values that no view can show"):
        for step in range(model.culled.interval + 1):
            trainer.step(step)


def test_a_scale_that_is_large_but_drawn_is_not_counted():
    model = everywhere()
    model.gauss_params["scales"].data[:] = 15.0
    assert model.culled_static() == 0
    assert math.isfinite(TOO_WIDE)


# --- what may be saved -----------------------------------------------------------------------


def test_some_culled_gaussians_may_be_saved_but_not_most(tmp_path):
    trainer = GuardedTrainer(everywhere())
    model, means = trainer.model, trainer.model.gauss_params["means"].data
    means[:3] = NAN
    check_parameters(model, trainer.optimizers, 5, tmp_path, strict=False)
    with pytest.raises(TrainingError, match="means are not finite"):
        check_parameters(model, trainer.optimizers, 5, tmp_path, strict=True)
    means[: len(means) // 2 + 1] = NAN
    with pytest.raises(TrainingError, match=r"16 of 30 static Gaussians.*start anew"):
        check_parameters(model, trainer.optimizers, 5, tmp_path, strict=False)


def test_a_network_that_is_not_finite_may_not_be_saved(tmp_path):
    from desplat_ns.effects import EffectsConfig

    model = make_model(
        effects=EffectsConfig(appearance="affine", background=True),
        appearance=AppearanceConfig(),
        background=BackgroundConfig(),
    )
    trainer = GuardedTrainer(model)
    check_parameters(model, trainer.optimizers, 5, tmp_path, strict=False)
    assert model.image_effects is not None
    for name, parameters in model.image_effects.param_groups().items():
        kept = parameters[0].data.clone()
        parameters[0].data.view(-1)[0] = NAN
        with pytest.raises(TrainingError, match=f"{name} are not finite"):
            check_parameters(model, trainer.optimizers, 5, tmp_path, strict=False)
        parameters[0].data = kept


def test_mixed_precision_leaves_gradients_to_its_scaler(capsys):
    """Its first scale is meant to overflow; it halves it by itself."""
    guard, optimizers = StepGuard(1), Optimizers({}, {})
    scaler = SimpleNamespace(is_enabled=lambda: True)
    model = SimpleNamespace(losses={"main_loss": torch.tensor(1.0)})
    assert guard.is_sound(0, model, optimizers, scaler)
    model.losses["main_loss"] = torch.tensor(NAN)
    assert not guard.is_sound(0, model, optimizers, scaler)
    assert guard.exhausted
    assert "the loss (main_loss)" in said(capsys)


def test_nothing_is_culled_always_in_a_healthy_scene():
    from desplat_ns.gaussians.activation import activate_static

    assert not culled_always(activate_static(everywhere().gauss_params, 0)).any()
