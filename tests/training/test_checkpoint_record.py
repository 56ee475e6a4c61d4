"""The record in a checkpoint: read back as written, and every difference has its message."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import pytest
import torch

from desplat_ns.errors import CheckpointError
from desplat_ns.training.checkpoint_record import FORMAT, SceneRecord, check_same_scene

HERE = SceneRecord({"distractors": True}, 3, ["a.png", "b.png", "c.png"])


def test_a_record_survives_a_checkpoint_read_with_weights_only():
    file = io.BytesIO()
    torch.save(HERE.to_state(), file)
    file.seek(0)
    assert SceneRecord.from_state(torch.load(file, weights_only=True)) == HERE


def test_the_same_scene_is_accepted():
    check_same_scene(HERE, HERE)
    check_same_scene(replace(HERE, train_images=[]), HERE)  # unknown on one side
    check_same_scene(HERE, replace(HERE, train_images=[]))


@pytest.mark.parametrize("state", [None, {"effects": {}}, HERE.to_state() | {"format": FORMAT + 1}])
def test_a_checkpoint_of_another_method_or_version_is_refused(state: object):
    with pytest.raises(CheckpointError):
        SceneRecord.from_state(state)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"effects": {"distractors": False}}, "--pipeline.model.effects.distractors False"),
        ({"sh_degree": 2}, "--pipeline.model.sh-degree 2"),
        ({"train_images": ["a.png", "x.png", "y.png"]}, "'x.png'"),
        ({"train_images": ["a.png", "b.png"]}, "'c.png'"),
        ({"train_images": ["b.png", "a.png", "c.png"]}, "order"),
    ],
)
def test_what_differs_is_named_with_the_option_to_set(change: dict, named: str):
    with pytest.raises(CheckpointError, match=re.escape(named)):
        check_same_scene(replace(HERE, **change), HERE)
