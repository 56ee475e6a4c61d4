"""The viewer's layer control: off by default, off in evaluations, each layer what it says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
import torch
from nerfstudio.viewer.utils import parse_object
from nerfstudio.viewer.viewer_elements import ViewerElement
from torch import nn

from desplat_ns.photo_tourism.shown_light import WornAppearance
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.viewer import LAYERS, LayerControl


def _outputs() -> dict[str, torch.Tensor]:
    static, composite = torch.full((1, 2, 3), 0.25), torch.full((1, 2, 3), 0.5)
    return {
        "rgb": static,
        "rgb_static": static,
        "rgb_composite": composite,
        "rgb_distractor": torch.full((1, 2, 3), 1.5),
        "distractor_mask": torch.tensor([[[True], [False]]]),
    }


def test_without_a_viewer_nothing_changes():
    control, outputs = LayerControl(5), _outputs()
    assert control.train_idx() is None
    assert control.apply(outputs) is outputs


@pytest.mark.parametrize("layer", [name for name in LAYERS if name != "static"])
def test_a_layer_asks_for_the_distractors_of_the_chosen_view(layer: str):
    control = LayerControl(5)
    control.layer.value, control.view.value = layer, 3
    assert control.train_idx() == 3


def test_the_chosen_view_never_lies_beyond_the_last():
    control = LayerControl(1)
    control.layer.value, control.view.value = "composite", 1
    assert control.train_idx() == 0


@pytest.mark.parametrize(
    ("layer", "expected"),
    [
        ("composite", [[[0.5] * 3, [0.5] * 3]]),
        ("distractors", [[[1.0] * 3, [1.0] * 3]]),  # a picture ends at white
        ("mask", [[[1.0] * 3, [0.0] * 3]]),
    ],
)
def test_the_chosen_layer_stands_in_rgb(layer: str, expected: list):
    control = LayerControl(5)
    control.layer.value = layer
    outputs = _outputs()
    shown = control.apply(outputs)
    assert torch.equal(shown["rgb"], torch.tensor(expected))
    assert torch.equal(shown["rgb_static"], outputs["rgb"])


def test_while_suspended_an_open_viewers_choice_does_not_count():
    control, outputs = LayerControl(5), _outputs()
    control.layer.value = "composite"
    with control.suspended():
        assert control.train_idx() is None
        assert control.apply(outputs) is outputs
    assert control.train_idx() == 0


def test_an_error_does_not_leave_the_control_suspended():
    control = LayerControl(5)
    control.layer.value = "composite"
    with pytest.raises(KeyError), control.suspended():
        raise KeyError
    assert control.train_idx() == 0


def _pipeline(num_views: int, images: Sequence[str] = ()) -> DeSplatPipeline:
    pipeline = DeSplatPipeline.__new__(DeSplatPipeline)
    nn.Module.__init__(pipeline)
    model: Any = nn.Module()
    model.device = torch.device("cpu")
    model.layer_control = LayerControl(num_views)
    model.worn = WornAppearance(images)
    pipeline._model = model
    return pipeline


def test_nerfstudios_viewer_finds_both_controls_on_the_pipeline():
    found = parse_object(_pipeline(5), ViewerElement, "Custom Elements")
    assert {path for path, _ in found} == {"Custom Elements/layer", "Custom Elements/training_view"}


def test_an_appearance_model_adds_three_controls():
    found = parse_object(_pipeline(0, ["a.jpg", "b.jpg"]), ViewerElement, "Custom Elements")
    names = {"appearance", "appearance_mixed", "appearance_share"}
    assert {path for path, _ in found} == {f"Custom Elements/{name}" for name in names}


def test_no_controls_are_shown_where_there_are_no_distractors():
    assert parse_object(_pipeline(0), ViewerElement, "Custom Elements") == []
