"""A step of a capture of thousands of photos is the step of one of a few."""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

import pytest
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from desplat_ns.core.effects import Effects
from desplat_ns.distractors.distractors import LOOK_EVERY
from lab.bench.model_step import LATE, ModelStep
from lab.bench.scenes import make_scene

FEW, MANY = 23, 503
"""Primes, which are the size of nothing else in a step."""

LOOKED_AT = next(
    step
    for step in range(LATE + 1, sys.maxsize, 10)  # no multiple of any interval
    if all(step // views % LOOK_EVERY == 0 for views in (FEW, MANY))
)
"""A step at which photos are compared with the scene, whatever their number."""

ON_TABLES = 20
"""Operations, at most, on a table with a few numbers of each photo's light: its optimizer's step,
its mean, the row that is drawn. 64,000 numbers of 2,000 photos take some ten microseconds each."""


class Operations(TorchDispatchMode):
    """Counts the operations within by name and by the shapes of all that they take and give."""

    def __init__(self, views: int):
        super().__init__()
        self.counts: Counter[Any] = Counter()
        self._views = views

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):  # type: ignore[override]
        result = func(*args, **(kwargs or {}))
        shapes = [
            tuple(t.shape) for t in tree_leaves((args, kwargs, result)) if isinstance(t, Tensor)
        ]
        named = tuple(tuple("V" if n == self._views else n for n in shape) for shape in shapes)
        self.counts[str(func), named] += 1
        return result


def work_of_a_step(effects: Effects, views: int) -> tuple[Counter[Any], Counter[Any]]:
    """Operations of torch, and calls of Python's and C's functions, of a step that draws, weighs,
    pulls back, steps and refines nothing; the photo shows the static scene."""
    step = ModelStep(make_scene(100, 48, 32), effects, views, backend="torch")
    model = step.model.eval()
    step.photo = model.get_outputs_for_camera(step.camera)["rgb"].clone()
    model.train()
    model.step = LOOKED_AT

    def whole() -> None:
        step()
        model.step_post_backward(model.step)

    whole()  # what is made once
    with Operations(views) as operations:
        whole()
    calls: Counter[Any] = Counter()

    def count(frame: Any, event: str, called: Any) -> None:
        where = frame.f_globals.get("__name__", "")
        if event in ("call", "c_call"):
            calls[where, getattr(called, "__name__", "") or frame.f_code.co_name] += 1

    sys.setprofile(count)
    try:
        whole()
    finally:
        sys.setprofile(None)
    return operations.counts, calls


@pytest.mark.usefixtures("unchecked_types")  # checks of types look at some items of a sequence
@pytest.mark.parametrize(
    "effects",
    [
        Effects(distractors=True),
        Effects(distractors=True, appearance="affine", background="image"),
    ],
    ids=lambda effects: f"{effects.appearance}-{effects.background}",
)
def test_a_step_does_the_same_whatever_the_number_of_photos(effects: Effects):
    (few, few_calls), (operations, calls) = (work_of_a_step(effects, n) for n in (FEW, MANY))
    assert operations == few
    # A loop over the photos would call at least one function more for each of them.
    assert calls.total() - few_calls.total() < MANY - FEW
    assert operations.total() > 1000 and calls.total() > 1000
    on_tables = [what for what in operations.elements() if "V" in str(what[1])]
    assert len(on_tables) <= (0 if effects.appearance == "off" else ON_TABLES), on_tables
