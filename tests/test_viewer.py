"""The viewer: its layers, each what it says and off in evaluations."""

from nerfstudio.viewer.utils import parse_object
from nerfstudio.viewer.viewer_elements import ViewerElement
from torch import nn

from desplat_ns.photo_tourism.shown_light import ShownLight
from desplat_ns.training.pipeline import DeSplatPipeline
from desplat_ns.viewer import LayerControl
from tests.helpers.small_model import make_model

NAMES = [f"{number}.jpg" for number in range(5)]


def test_nerfstudios_viewer_finds_all_controls_on_the_pipeline():
    pipeline = DeSplatPipeline.__new__(DeSplatPipeline)
    nn.Module.__init__(pipeline)
    pipeline._model = model = make_model()
    model.layer_control = LayerControl(NAMES)
    model.shown_light = ShownLight(["a.jpg", "b.jpg"])
    controls = parse_object(pipeline, ViewerElement, "Custom Elements")
    assert {path.removeprefix("Custom Elements/model/") for path, _ in controls} == {
        *(f"layer_control/{name}" for name in ("layer", "view")),
        "shown_light/choice",
    }
    model.layer_control, model.shown_light = LayerControl([]), ShownLight([])
    assert parse_object(pipeline, ViewerElement, "Custom Elements") == []
