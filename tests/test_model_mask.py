"""What the user's mask leaves out moves nothing, by any term."""

from typing import Any

import pytest
import torch

from desplat_ns.distractors.config import DistractorConfig
from tests.helpers.small_model import HEIGHT, WIDTH, camera, distractors_of, make_model

OURS: dict[str, Any] = {"static_alone": True, "lambda_d": 0.1, "leak": 0.03}
PAPERS: dict[str, Any] = {"static_warmup": 0}
WARMING_UP: dict[str, Any] = {"static_warmup": 100}


def gradients(options: dict[str, Any], backend: str, mask: torch.Tensor) -> Any:
    """The model of a small wall after the backward pass of one step."""
    x, y = torch.meshgrid(
        torch.linspace(-1.5, 1.5, 16), torch.linspace(-1.2, 1.2, 12), indexing="xy"
    )
    points = torch.stack([x, y, torch.zeros_like(x)], dim=-1).reshape(-1, 3)
    distractors = DistractorConfig(per_view=100, **options)
    model = make_model(points, backend=backend, opacity_prior=0.2, distractors=distractors)
    model.train()
    model.step, model.optimizers = 0, {}
    with torch.no_grad():
        model.gauss_params["scales"] -= 0.7  # so that a footprint is a few pixels
    photo = torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(1))
    losses = model.get_loss_dict(model(camera(1)), {"image": photo, "mask": mask})
    assert "opacity_prior" in losses
    torch.stack(list(losses.values())).sum().backward()
    return model


def moved(params: Any) -> torch.Tensor:
    """Which Gaussians have a gradient."""
    given = [value.grad.flatten(1) for value in params.values() if value.grad is not None]
    return torch.cat(given, dim=1).abs().amax(dim=1) > 0


@pytest.mark.parametrize(
    ("options", "backend"),
    [(OURS, "numba"), (OURS, "torch"), (PAPERS, "numba"), (WARMING_UP, "numba")],
)
def test_what_is_masked_is_not_moved_in_half_of_a_photo_or_in_all_of_it(options, backend):
    mask = torch.zeros(HEIGHT, WIDTH, 1)
    model = gradients(options, backend, mask)
    assert not moved(model.gauss_params).any()
    for value in distractors_of(model, 1).values():
        assert value.grad is None or not value.grad.any()
    mask[:, WIDTH // 2 :] = 1
    model = gradients(options, backend, mask)
    drawn: list[Any] = [(model.gauss_params, model.train_step.static)]
    if model.train_step.distractors is not None:
        drawn.append((distractors_of(model, 1), model.train_step.distractors))
    for params, rendering in drawn:
        right = rendering.means2d.detach()[0, :, 0] + rendering.radii
        in_masked = rendering.visible & (right < WIDTH // 2 - 1)
        in_counted = rendering.visible & (rendering.means2d.detach()[0, :, 0] > WIDTH // 2)
        assert in_masked.sum() > 5 and in_counted.sum() > 5
        assert not moved(params)[in_masked].any()
        assert moved(params)[in_counted].any()
