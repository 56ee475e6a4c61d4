"""A stopwatch measures forward."""

from __future__ import annotations

import torch

from desplat_ns.evaluation.stopwatch import Stopwatch


def test_a_stopwatch_goes_forward():
    watch = Stopwatch(torch.device("cpu"))
    watch.start()
    first = watch.seconds()
    assert 0 <= first <= watch.seconds()
