"""A run that is scored on its way is the run that it would have been."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
import torch

from desplat_ns.studies.curve import TrainingClock, scored_steps
from desplat_ns.studies.runs import QUIET
from desplat_ns.studies.train_and_score import train_and_score
from lab.synthetic import Scene

STEPS = 12
TIMES = {"train_cpu_seconds", "train_wall_seconds"}


def test_runs_are_scored_after_halves_of_their_steps():
    assert scored_steps(1000, 4) == [125, 250, 500, 1000]
    assert scored_steps(1000, 1) == [1000]
    assert scored_steps(3, 5) == [1, 3]


def test_a_paused_clock_stands_still():
    clock = TrainingClock()
    before = clock.seconds()["train_wall_seconds"]
    with clock.paused():
        time.sleep(0.5)
    assert clock.seconds()["train_wall_seconds"] - before < 0.5


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_scoring_on_the_way_changes_nothing_of_the_run(tiny_scene: Scene, tmp_path: Path):
    options = ["--data", str(tiny_scene.folder), "--max-num-iterations", str(STEPS), *QUIET]
    options += ["--pipeline.model.effects.auto", "False"]
    records = {}
    for evaluations in (1, 3):
        place = tmp_path / str(evaluations)
        torch.rand(evaluations)  # as whatever ran before
        arguments = [*options, "--output-dir", str(place), "robustnerf-data"]
        records[evaluations] = train_and_score("desplat", arguments, place / "p", evaluations)
    once, often = (records[n]["figures"] for n in (1, 3))
    same = {name for name in once if "seconds" not in name}
    assert {n: once[n] for n in same} == {n: often[n] for n in same}
    assert records[1]["curve"] == []
    curve = records[3]["curve"]
    assert [point["step"] for point in curve] == [3, 6, 12]
    assert all({"psnr", "mask_iou", *TIMES} <= point.keys() for point in curve)
    assert curve[-1]["psnr"] == often["psnr"] != curve[0]["psnr"]
    walls = [point["train_wall_seconds"] for point in curve]
    assert walls == sorted(walls)
