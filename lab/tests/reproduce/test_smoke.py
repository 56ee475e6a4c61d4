"""Tables end to end on generated scenes that lie as the published ones do."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from desplat_ns.reproduce.estimate import expected_seconds
from desplat_ns.reproduce.grid import Request, reproduce, run_of
from desplat_ns.reproduce.methods import METHODS
from desplat_ns.reproduce.protocols import Smoke
from desplat_ns.reproduce.scenes import checked, find_scenes
from desplat_ns.reproduce.tables import TABLES
from desplat_ns.studies.executors import Keep, RayExecutor
from desplat_ns.studies.runs import Run
from lab.reproduce.data_sets import TINY, write_on_the_go, write_robustnerf
from lab.reproduce.here import InThisProcess
from lab.reproduce.smoke import GROUPS, missing_figures
from lab.synthetic import make_scene

pytestmark = [pytest.mark.usefixtures("tyro_may_build"), pytest.mark.slow]

SMOKE = Smoke(steps=4, side=48)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene of each of two data sets."""
    folder, scene = tmp_path_factory.mktemp("data"), make_scene(TINY)
    write_robustnerf(scene, folder / "robustnerf" / "yoda")
    write_on_the_go(scene, folder / "on-the-go" / "patio_high")
    return folder


def request_of(data: Path, output: Path, executor, methods=("desplat-paper",)) -> Request:
    chosen = tuple(METHODS[name] for name in methods)
    return Request(TABLES["A7"], data, output, chosen, 1, executor, 1, "cpu", smoke=SMOKE)


def figures_in(folder: Path) -> dict[tuple[str, str, str], str]:
    with (folder / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {(r["scene"], r["method"], r["metric"]): r["mean"] for r in rows}


def test_a_smoke_table_of_two_data_sets_trains_scores_and_is_written(data, tmp_path):
    request = request_of(data, tmp_path / "out", InThisProcess())
    folder = reproduce(request)
    with (folder / "table.csv").open(newline="") as file:
        rows = {(row["scene"], row["metric"]): row for row in csv.DictReader(file)}
    assert {scene for scene, _ in rows} == {"Yoda", "Patio-High", "mean"}
    assert {metric for _, metric in rows} == {"static_mb", "distractor_mb"}
    assert all(row["paper"] == "" and row["smoke"] == "True" for row in rows.values())
    conditions = json.loads((folder / "table.json").read_text())["conditions"]
    assert conditions["steps"] == ["4"] and conditions["scored"] == [
        "full image, static Gaussians only"
    ]
    assert conditions["scenes"]["Patio-High"]["starts from"] == "random points"
    assert conditions["versions"] and "SMOKE" in (folder / "table.md").read_text()
    assert not list(request.output.rglob("nerfstudio_models")), "nobody needs them"
    before = (folder / "table.md").read_bytes()
    again = replace(request, executor=Killed(most=0))
    assert reproduce(again) == folder
    assert (folder / "table.md").read_bytes() == before, "all of it was done"


@dataclass
class Killed:
    """An executor that is killed on the way."""

    most: int

    def do(self, runs: Iterable[Run], folder: Path, keep: Keep) -> list[bool]:
        """See `Executor`."""
        for number, run in enumerate(runs):
            if number == self.most:
                raise KeyboardInterrupt
            InThisProcess().do([run], folder, keep)
        return []


def test_a_table_that_was_killed_goes_on_and_has_the_same_figures(data, tmp_path):
    methods = ("desplat-paper", "splatfacto")
    whole = reproduce(request_of(data, tmp_path / "whole", InThisProcess(), methods))
    with pytest.raises(KeyboardInterrupt):
        reproduce(request_of(data, tmp_path / "out", Killed(most=2), methods))
    kept = set(json.loads((tmp_path / "out" / "records.json").read_text())["done"])
    assert len(kept) == 2
    folder = reproduce(request_of(data, tmp_path / "out", InThisProcess(), methods))
    assert figures_in(folder) == figures_in(whole) != {}


def test_ray_gives_the_same_table_as_this_machine(data, tmp_path):
    pytest.importorskip("ray", reason="Ray is not installed (pip install 'desplat-ns[ray]')")
    here = reproduce(request_of(data, tmp_path / "here", InThisProcess()))
    there = reproduce(request_of(data, tmp_path / "there", RayExecutor(jobs=1)))
    assert figures_in(there) == figures_in(here) != {}


def test_the_time_of_a_table_is_that_of_its_steps(data):
    scenes, _ = find_scenes(TABLES["robustnerf"], data)
    scene = next(iter(checked(scenes, SMOKE)))
    run = run_of(scene, METHODS["splatfacto"], 42)
    seconds = expected_seconds(scene, [run], "cpu")
    assert seconds is not None and 30_000 * 1e-3 < seconds < 30_000 * 10


def test_every_table_is_tried_and_a_figure_that_is_missing_is_named(tmp_path):
    assert sorted(name for group in GROUPS for name in group) == sorted(TABLES)
    cells = [
        {"scene": scene.name, "method": method, "metric": "train_seconds"}
        for scene in TABLES["A8"].scenes
        for method in TABLES["A8"].methods
    ]
    content = {"cells": cells[1:], "conditions": {"LPIPS net": []}}
    (tmp_path / "table.json").write_text(json.dumps(content))
    assert missing_figures("A8", tmp_path) == ["A8 has no train_seconds of desplat on Statue."]
