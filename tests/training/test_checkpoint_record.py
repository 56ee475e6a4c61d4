"""The record in a checkpoint: read back as written, and every difference has its message."""

from __future__ import annotations

import io
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


@pytest.mark.parametrize("side", ["saved", "here"])
def test_photos_unknown_on_one_side_are_not_compared(side: str):
    unknown = replace(HERE, train_images=[])
    check_same_scene(*((unknown, HERE) if side == "saved" else (HERE, unknown)))


@pytest.mark.parametrize("state", [None, {}, "text", {"effects": {}}])
def test_a_checkpoint_of_another_method_is_named_as_such(state: object):
    with pytest.raises(CheckpointError, match="not saved by `desplat`"):
        SceneRecord.from_state(state)


@pytest.mark.parametrize("change", [{"format": FORMAT + 1}, {"sh_degree": None}])
def test_a_checkpoint_of_another_version_is_named_as_such(change: dict):
    state = {k: v for k, v in (HERE.to_state() | change).items() if v is not None}
    with pytest.raises(CheckpointError, match="another version saved it"):
        SceneRecord.from_state(state)


def test_other_effects_are_named_with_the_switch_to_set():
    saved = replace(HERE, effects={"distractors": False})
    with pytest.raises(CheckpointError, match=r"--pipeline\.model\.effects\.distractors False"):
        check_same_scene(saved, HERE)


def test_another_sh_degree_is_named_with_the_option_to_set():
    with pytest.raises(CheckpointError, match=r"--pipeline\.model\.sh-degree 2"):
        check_same_scene(replace(HERE, sh_degree=2), HERE)


def test_another_scene_is_counted_and_its_first_photo_named():
    other = replace(HERE, train_images=["a.png", "x.png", "y.png"])
    with pytest.raises(CheckpointError, match=r"4 names differ.*'x\.png', which only the checkp"):
        check_same_scene(other, HERE)


def test_photos_that_were_added_are_named():
    fewer = replace(HERE, train_images=["a.png", "b.png"])
    with pytest.raises(CheckpointError, match=r"1 names differ.*'c\.png', which only this run"):
        check_same_scene(fewer, HERE)


def test_the_same_photos_in_another_order_are_not_the_same_views():
    shuffled = replace(HERE, train_images=["b.png", "a.png", "c.png"])
    with pytest.raises(CheckpointError, match="another order"):
        check_same_scene(shuffled, HERE)
