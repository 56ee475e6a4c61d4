"""Which checkpoints the pipeline loads, and what it says of those that it refuses."""

from __future__ import annotations

from typing import Any

import pytest

from desplat_ns.errors import CheckpointError
from desplat_ns.pipeline import DeSplatPipeline
from tests.helpers.known_pipeline import KnownManager, known_pipeline


def _saved(**changes: Any) -> dict[str, Any]:
    """A checkpoint's pipeline state, whose static Gaussians all lie at 1."""
    pipeline = known_pipeline(**changes)
    pipeline.model.gauss_params["means"].data.fill_(1.0)
    return pipeline.state_dict()


def _is_untouched(pipeline: DeSplatPipeline) -> bool:
    return pipeline.model.step == 0 and not (pipeline.model.means == 1).any()


def test_a_checkpoint_of_the_same_scene_is_loaded_with_its_step():
    pipeline = known_pipeline()
    pipeline.load_pipeline(_saved(), 7)
    assert (pipeline.model.gauss_params["means"] == 1).all()
    assert pipeline.model.step == 7


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"manager": KnownManager(train_image_names=["x.png"])}, "another scene"),
        ({"distractors": False}, r"--pipeline\.model\.effects\.distractors False"),
    ],
)
def test_another_scene_or_other_effects_are_refused_before_anything_changes(
    changes: dict, message: str
):
    pipeline = known_pipeline()
    with pytest.raises(CheckpointError, match=message):
        pipeline.load_pipeline(_saved(**changes), 7)
    assert _is_untouched(pipeline)


def test_missing_and_unexpected_parameters_are_named():
    pipeline, state = known_pipeline(), _saved()
    state["_model.extra"] = state.pop("_model.distractors.views.1.means")
    with pytest.raises(CheckpointError, match=r"(?s)distractors\.views\.1\.means.*extra"):
        pipeline.load_pipeline(state, 7)


def test_a_checkpoint_of_another_method_is_refused():
    state = _saved()
    del state["_extra_state"]
    with pytest.raises(CheckpointError, match="not saved by `desplat`"):
        known_pipeline().load_pipeline(state, 7)


@pytest.mark.parametrize("group", ["gauss_params", "distractors.views.1"])
def test_parameters_of_unequal_numbers_of_gaussians_are_refused(group: str):
    pipeline, state = known_pipeline(), _saved()
    state[f"_model.{group}.scales"] = state[f"_model.{group}.means"].repeat(2, 1)
    with pytest.raises(CheckpointError, match="unequal"):
        pipeline.load_pipeline(state, 7)
    assert _is_untouched(pipeline)
