from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import pytest
import torch

from lab.gpu.parts.synchronisations import WINDOW, Watch, names_within, per_step


@dataclass
class Span:
    start: float
    end: float


@dataclass
class Event:
    name: str
    time_range: Span


def test_only_what_begins_within_the_steps_is_counted():
    wait = "cudaStreamSynchronize"
    events = [Event(wait, Span(t, t + 1)) for t in (5, 10, 15, 20, 25)]
    events += [Event(WINDOW, Span(10, 20)), Event(WINDOW, Span(16, 17))]
    assert names_within(events) == Counter({wait: 3})
    with pytest.raises(ValueError, match="lost the steps"):
        names_within(events[:5])


def test_kinds_are_summed_and_divided_by_the_steps():
    names = Counter(
        {
            **{"cudaStreamSynchronize": 6, "cudaMemcpy": 2, "cudaLaunchKernel": 40},
            **{"Memcpy DtoH (Device -> Pageable)": 4, "Memcpy DtoH (Device -> Pinned)": 2},
            **{"Memcpy DtoD": 9, "cudaMemcpyAsync": 15, "aten::nonzero": 1},
        }
    )
    figures = per_step(names, 2)
    assert figures["waits"] == 4 and figures["launches"] == 20
    assert figures["Memcpy DtoH"] == 3 and figures["Memcpy HtoD"] == 0
    assert figures["aten::nonzero"] == 0.5


def test_the_profiler_counts_what_the_marked_steps_do():
    """Three steps that read two numbers each, between two that read nine."""
    watch: Any = Watch("cpu")
    trainer: Any = type("Trainer", (), {"callbacks": []})()
    watch.attach(trainer, first=1, count=3)
    before, after = trainer.callbacks
    for step in range(5):
        before.run_callback(step)
        for _ in range(2 if 1 <= step <= 3 else 9):
            torch.ones(3).sum().item()
        after.run_callback(step)
    assert per_step(names_within(watch.events), 3)["aten::_local_scalar_dense"] == 2
