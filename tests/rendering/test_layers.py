"""The images that come out of the model."""

import torch

from desplat_ns.backend.protocol import Rendering
from desplat_ns.rendering.compositing import over_background
from desplat_ns.rendering.layers import layered_outputs, static_outputs

BLUE = torch.tensor([0.0, 0.0, 1.0])


def layer(rgb: list[float], alpha: list[float], depth: list[float] | None = None) -> Rendering:
    """A layer of one row: each pixel's colour is `rgb` times its alpha."""
    a = torch.tensor(alpha).reshape(1, -1, 1)
    d = None if depth is None else torch.tensor(depth).reshape(1, -1, 1)
    return Rendering(torch.tensor(rgb) * a, a, d, torch.zeros(1, 0, 2), torch.zeros(0).int())


def over_blue(static: Rendering) -> torch.Tensor:
    return over_background(static.rgb, static.alpha, BLUE)


def outputs_of(static: Rendering) -> dict[str, torch.Tensor]:
    return static_outputs(static, over_blue(static), BLUE)


def test_the_static_scene_lies_over_the_background():
    outputs = outputs_of(layer([2.0, 0, 0], [0.0, 0.25, 1.0]))
    expected = torch.tensor([[[0, 0, 1.0], [0.5, 0, 0.75], [1.0, 0, 0]]])  # cut off at 1
    assert torch.equal(outputs["rgb"], expected)
    assert "depth" not in outputs


def test_where_nothing_is_depth_is_the_farthest():
    outputs = outputs_of(layer([1.0, 0, 0], [0.5, 0.0, 1.0], depth=[2.0, 0.0, 7.0]))
    assert outputs["depth"].flatten().tolist() == [2.0, 7.0, 7.0]


def test_the_distractors_and_the_composite_are_outputs_of_their_own():
    static, distractor = layer([0, 1.0, 0], [1.0, 0.5]), layer([1.0, 0, 0], [0.25, 0.75])
    outputs = layered_outputs(over_blue(static), outputs_of(static)["rgb"], distractor)
    assert torch.equal(outputs["rgb_distractor"], distractor.rgb)
    # 0.25 red + 0.75 green; 0.75 red + 0.25 * (0.5 green + 0.5 blue).
    expected = torch.tensor([[[0.25, 0.75, 0], [0.75, 0.125, 0.125]]])
    assert torch.equal(outputs["rgb_composite"], expected)
    assert outputs["distractor_mask"].flatten().tolist() == [False, True]


def test_without_distractors_their_layer_is_empty():
    static = layer([0, 1.0, 0], [1.0, 0.5])
    outputs = layered_outputs(over_blue(static), outputs_of(static)["rgb"], None)
    assert torch.equal(outputs["rgb_composite"], outputs_of(static)["rgb"])
    assert not outputs["alpha_distractor"].any()
    assert not outputs["distractor_mask"].any()
