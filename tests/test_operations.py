"""A training step dispatches few operations of torch: each is a launch on a GPU."""

from collections.abc import Callable
from contextlib import nullcontext

import pytest
import torch

from desplat_ns.backend import gsplat_cuda
from desplat_ns.distractors.config import DistractorConfig
from lab.operations import as_on_cuda, operations_of, table_of
from tests.helpers.small_model import HEIGHT, WIDTH, Trainer, camera, make_model

BUDGETS = {
    ("cpu", "no distractors"): 70,
    ("cpu", "distractors drawn"): 105,
    ("cpu", "photo compared"): 156,
    ("cuda", "no distractors"): 130,
    ("cuda", "distractors drawn"): 180,
    ("cuda", "photo compared"): 305,
}
"""Operations of drawing, losses and the backward pass, without those of rasterizers; on CUDA
without fused-ssim."""


def a_step(on_cuda: bool, what: str) -> Callable[[], None]:
    """After one that made what later steps find."""
    is_drawn = what != "no distractors"
    start = "everywhere" if is_drawn else "residual"
    own = DistractorConfig(20, start=start, static_alone=True, leak=0.03, static_warmup=0)
    model = make_model(distractors=own, opacity_prior=0.2)
    if on_cuda:
        model.rasterizer = gsplat_cuda.GsplatRasterizer()
    model.distractors.looks = lambda step: False
    model.distractors.sweep.photos[0] = None  # was kept at the first visit
    model.distractors.sweep.unexplained = lambda index, device: torch.rand(HEIGHT, WIDTH)
    if is_drawn:
        model.distractors.regions[0] = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    trainer, at_hand = Trainer(model), camera(0)
    trainer.step(8000)
    model.step = 8001
    model.distractors.looks = lambda step: what == "photo compared"

    def step() -> None:
        losses = model.get_loss_dict(model(at_hand), {"image": trainer.photo})
        torch.stack(list(losses.values())).sum().backward()

    return step


@pytest.mark.parametrize(("device", "what"), BUDGETS)
def test_a_step_dispatches_no_more_operations_than_its_budget(device, what):
    with as_on_cuda() if device == "cuda" else nullcontext():
        places = operations_of(a_step(device == "cuda", what))
    assert places.total() <= BUDGETS[device, what], table_of(places, 99)
