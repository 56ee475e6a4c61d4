"""The model with distractors placed by residual, and a static scene that is trained alone."""

from typing import Any

import pytest
import torch

from desplat_ns import losses
from desplat_ns.backend.ssim import compiled_photometric
from desplat_ns.cameras.views import image_points, view_of
from desplat_ns.core.effects import EffectsConfig
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.placement import distractor_weight
from tests.helpers.small_model import HEIGHT, WIDTH, Trainer, camera, distractors_of, make_model

NO_DENSIFICATION: dict[str, Any] = {"warmup_length": 10_000}


def config(**changes: Any) -> DistractorConfig:
    values = {"per_view": 120, "initial_opacity": 0.5, "start": "residual", "static_alone": True}
    return DistractorConfig(**values | changes)


def a_dense_model(**changes: Any) -> Any:
    """A static scene that fills the views, so that every cell has somebody to remember it."""
    side = torch.linspace(-1.5, 1.5, 24)
    x, y = torch.meshgrid(side, side, indexing="ij")
    points = torch.stack([x, y, torch.zeros_like(x)], dim=-1).reshape(-1, 3)
    return make_model(points, distractors=config(**changes), **NO_DENSIFICATION)


class Crossing(Trainer):
    """Three views of a grey scene; in view 0 something magenta stands in the way."""

    def __init__(self, model: Any):
        super().__init__(model)
        self.gray = torch.full((HEIGHT, WIDTH, 3), 0.5)
        self.crossed = self.gray.clone()
        self.crossed[5:15, 6:16] = torch.tensor([1.0, 0.0, 1.0])

    def visit(self, step: int, view: int) -> dict[str, Any]:
        self.photo = self.crossed if view == 0 else self.gray
        return self.step(step, view)


def warmed_up() -> Crossing:
    """After the 60 steps of the warm-up, on the two photos without an occluder."""
    trainer = Crossing(a_dense_model(static_warmup=60))
    for step in range(60):
        trainer.visit(step, 1 + step % 2)
    return trainer


@pytest.mark.slow
def test_distractors_appear_where_one_photo_differs_and_nowhere_else():
    trainer = warmed_up()
    model = trainer.model
    assert model.distractors.counts() == [0, 0, 0]
    trainer.visit(60, 0)
    placed, *others = model.distractors.counts()
    assert placed > 5
    for step in range(61, 91):
        trainer.visit(step, step % 3)
    assert others == model.distractors.counts()[1:] == [0, 0]
    alpha = trainer.visit(91, 0)["outputs"]["alpha_distractor"][..., 0]
    assert alpha[7:13, 8:14].mean() > 0.7
    assert alpha[:, 19:].mean() < 0.1
    colors = distractors_of(model, 0)["rgbs"]
    assert ((colors - torch.tensor([1.0, 0.0, 1.0])).abs().amax(-1) < 0.2).sum() > 5
    # The region is left out of the static loss whatever covers it.
    for group in trainer.optimizers.values():
        for options in group.param_groups:
            options["lr"] = 0.0
    distractors_of(model, 0)["opacities"].data.fill_(-20.0)
    visit = trainer.visit(92, 0)
    assert visit["outputs"]["alpha_distractor"].max() < 0.01
    assert (visit["outputs"]["rgb_static"] - trainer.crossed).abs()[5:15, 6:16].max() > 0.2
    assert visit["losses"]["static_photometric"] < 0.05


@pytest.mark.slow
def test_no_distractor_is_placed_where_the_users_mask_leaves_a_photo_out():
    """Left of the middle; what is seen to the right of a mask still counts."""
    trainer = warmed_up()
    model = trainer.model
    trainer.mask = torch.ones(HEIGHT, WIDTH, 1)
    trainer.mask[:, :11] = 0
    trainer.visit(60, 0)
    u, _, _ = image_points(distractors_of(model, 0)["means"].detach(), view_of(camera(0)))
    assert len(u) > 0 and ((u * WIDTH).round(decimals=3) >= 11).all()


@pytest.mark.parametrize(("step", "leaks"), [(0, True), (15_000, False)])
def test_what_distractors_own_leaks_as_long_as_the_static_set_grows(step, leaks):
    model = a_dense_model(start="everywhere", static_warmup=0)
    trainer = Trainer(model)
    trainer.step(0)
    model.step = step
    outputs, loss = model(camera(0)), []
    for model.distractors.config.leak in (0.0, 0.25):
        loss.append(model.get_loss_dict(outputs, {"image": trainer.photo})["static_photometric"])
    assert bool(loss[1] > loss[0]) == leaks


def test_without_distractors_in_the_view_the_static_loss_and_the_transparency_are_left():
    result = Trainer(a_dense_model(static_warmup=1000)).step(0)
    losses, outputs = result["losses"], result["outputs"]
    assert set(losses) == {"main_loss", "distractor_opacity", "static_transparency"}
    assert torch.equal(outputs["rgb"], outputs["rgb_static"])
    assert losses["distractor_opacity"] == 0
    transparency = (1 - outputs["accumulation"].double()).mean().item()
    assert losses["static_transparency"].item() == pytest.approx(0.01 * transparency, rel=1e-5)


def test_before_a_background_the_scene_may_be_empty_but_in_what_distractors_own():
    effects = EffectsConfig(background="sh")
    model = make_model(distractors=config(start="everywhere"), effects=effects)
    result = Trainer(model).step(0)
    losses, outputs = result["losses"], result["outputs"]
    owned = distractor_weight(outputs["alpha_distractor"]).double()
    transparency = 1 - outputs["accumulation"].double()
    in_owned = (owned * transparency).mean().item()
    assert 0.01 < in_owned < 0.9 * transparency.mean().item()
    assert losses["static_transparency"].item() == pytest.approx(0.01 * in_owned, rel=1e-4)
    model = make_model(distractors=config(start="everywhere", static_warmup=1000), effects=effects)
    assert "static_transparency" not in Trainer(model).step(0)["losses"]


@pytest.mark.parametrize(("backend", "is_compiled"), [("torch", False), ("numba", True)])
def test_backend_torch_computes_no_loss_by_compiled_kernels(monkeypatch, backend, is_compiled):
    called = []

    def compiled(*arguments: Any) -> Any:
        called.append(arguments)
        return compiled_photometric(*arguments)

    monkeypatch.setattr(losses, "compiled_photometric", compiled)
    Trainer(make_model(backend=backend)).step(1)
    assert bool(called) == is_compiled
