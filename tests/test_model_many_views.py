"""A step of a capture of thousands of photos is the step of one of a few."""

import sys
from typing import Any

import pytest

from desplat_ns.core.effects import Effects
from lab.bench.model_step import ModelStep
from lab.bench.scenes import make_scene

FEW, MANY = 23, 503

LOOKED_AT = 42 * MANY + 1
"""A step of round 42 of many photos and 918 of few: in every third round photos are compared with
the scene. Nothing is refined in it."""


def calls_of_a_step(effects: Effects, views: int) -> int:
    """Calls of Python's and C's functions in a step that draws, weighs, pulls back and steps; the
    photo shows the static scene."""
    step = ModelStep(make_scene(100, 48, 32), effects, views, backend="torch")
    model = step.model.eval()
    step.photo = model.get_outputs_for_camera(step.camera)["rgb"].clone()
    model.train()
    model.step = LOOKED_AT
    calls = 0

    def count(frame: Any, event: str, called: Any) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    def whole() -> None:
        step()
        model.step_post_backward(model.step)

    whole()  # what is made once
    sys.setprofile(count)
    try:
        whole()
    finally:
        sys.setprofile(None)
    return calls


@pytest.mark.usefixtures("unchecked_types")  # checks of types look at some items of a sequence
@pytest.mark.parametrize("light", [{}, {"appearance": "affine", "background": "image"}])
def test_a_step_does_the_same_whatever_the_number_of_photos(light: dict[str, Any]):
    """A loop over the photos would call at least one function more for each of them."""
    few, many = (calls_of_a_step(Effects(**light), views) for views in (FEW, MANY))
    assert few > 1000 and many - few < MANY - FEW
