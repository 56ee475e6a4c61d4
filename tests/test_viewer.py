"""The viewer: its layers, each what it says and off in evaluations, and where it opens."""

from __future__ import annotations

import math
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.viewer.utils import parse_object
from nerfstudio.viewer.viewer import Viewer
from nerfstudio.viewer.viewer_elements import ViewerElement
from torch import nn
from viser import ClientHandle

from desplat_ns.photo_tourism.shown_light import ShownLight
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.viewer import FirstPhotoView, LayerControl
from tests.helpers.small_model import make_model

NAMES = [f"{number}.jpg" for number in range(5)]


def test_an_evaluation_has_the_static_layer_whatever_the_viewer_says():
    control = LayerControl(NAMES)
    assert control.train_idx() is None
    control.layer.value, control.view.value = "mask", "3.jpg"
    assert control.train_idx() == 3
    with control.suspended():
        assert control.train_idx() is None


def test_nerfstudios_viewer_finds_all_controls_on_the_pipeline():
    pipeline = DeSplatPipeline.__new__(DeSplatPipeline)
    nn.Module.__init__(pipeline)
    pipeline._model = model = make_model()
    model.layer_control = LayerControl(NAMES)
    model.shown_light = ShownLight(["a.jpg", "b.jpg"])
    controls = parse_object(pipeline, ViewerElement, "Custom Elements")
    assert {path.removeprefix("Custom Elements/model/") for path, _ in controls} == {
        *(f"layer_control/{name}" for name in ("layer", "view")),
        *(f"shown_light/{name}" for name in ("first", "second", "share")),
    }
    model.layer_control, model.shown_light = LayerControl([]), ShownLight([])
    assert parse_object(pipeline, ViewerElement, "Custom Elements") == []


# --- where it opens ------------------------------------------------------------------------------


def _cameras() -> Cameras:
    """Two photos, twice as high as wide; the first is rolled, and looks aside and down."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    pose = np.eye(4)[:3]
    pose[:, :3], pose[:, 3] = turn * np.linalg.det(turn), (0.3, -0.6, 0.2)
    poses = torch.tensor(np.stack([pose, np.eye(4)[:3]]), dtype=torch.float32)
    return Cameras(poses, fx=30.0, fy=40.0, cx=15.0, cy=30.0, width=30, height=60)


def test_the_viewer_opens_where_the_first_training_photo_was_taken():
    cameras = _cameras()
    browser: Any = ClientHandle.__new__(ClientHandle)
    browser.atomic, browser.camera = nullcontext, SimpleNamespace(aspect=1.5)
    FirstPhotoView(cameras).show(browser)
    viewer: Any = SimpleNamespace(ready=False, current_camera_idx=0)
    state = Viewer.get_camera_state(viewer, browser)
    assert torch.allclose(state.c2w.float(), cameras.camera_to_worlds[0], atol=1e-6)
    assert state.fov == pytest.approx(2 * math.atan(30 / 40))  # from top to bottom
