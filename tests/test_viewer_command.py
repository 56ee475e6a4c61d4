"""`ns-viewer` on a tiny generated scene, with a stand-in for the browser."""

import math
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from nerfstudio.cameras.cameras import CameraType
from nerfstudio.scripts.viewer import run_viewer
from nerfstudio.viewer.render_state_machine import RenderStateMachine
from nerfstudio.viewer.utils import CameraState
from nerfstudio.viewer.viewer import Viewer

SIZE = (48, 32)


class _Started(Exception):
    """Raised in place of the viewer's endless wait."""


@pytest.fixture
def viewer(trained: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """`ns-viewer`, started without a browser."""
    started: list[Any] = []

    class Recorded(Viewer):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            started.append(self)

    def stop(seconds: float) -> None:
        raise _Started

    settings = run_viewer.ViewerConfigWithoutNumRays(websocket_host="127.0.0.1")
    monkeypatch.setattr(run_viewer, "ViewerState", Recorded)
    monkeypatch.setattr(run_viewer, "time", SimpleNamespace(sleep=stop))
    with pytest.raises(_Started):
        run_viewer.RunViewer(trained, settings).main()
    yield started[0]
    started[0].viser_server.stop()


def test_the_viewer_shows_each_layer_and_at_first_the_static_scene(viewer: Any):
    """Of training view 2, rendered as the viewer does for a browser."""
    sent: list[np.ndarray] = []
    aspect = SIZE[0] / SIZE[1]
    browser: Any = SimpleNamespace(
        camera=SimpleNamespace(aspect=aspect),
        scene=SimpleNamespace(set_background_image=lambda image, **_: sent.append(image)),
    )
    camera = viewer.pipeline.datamanager.train_dataset.cameras[2]
    fov = 2 * math.atan(float(camera.cy) / float(camera.fy))
    state = CameraState(fov, aspect, camera.camera_to_worlds, CameraType.PERSPECTIVE, idx=2)
    machine = RenderStateMachine(viewer, 10.0, browser)

    def frame() -> dict[str, torch.Tensor]:
        outputs = machine._render_img(state)
        machine._send_output_to_viewer(outputs)
        return outputs

    control = viewer.pipeline.model.layer_control
    assert {path for path, _ in viewer.viewer_elements} >= {
        "Custom Elements/model/layer_control/layer",
        "Custom Elements/model/layer_control/view",
    }
    outputs = frame()
    assert torch.equal(outputs["rgb"], outputs["rgb_static"])
    assert not outputs["alpha_distractor"].any()
    assert sent[-1].any()
    control.view.value = control.names[2]
    for layer, output in (
        ("composite", "rgb_composite"),
        ("distractors", "rgb_distractor"),
        ("mask", "distractor_mask"),
    ):
        control.layer.value = layer
        outputs = frame()
        expected = outputs[output].expand_as(outputs["rgb"]).float()
        assert torch.equal(outputs["rgb"], expected.clamp(0, 1))
        assert outputs["alpha_distractor"].any()
        assert sent[-1].dtype == np.uint8
    control.layer.value = "static"
    assert not frame()["alpha_distractor"].any()
