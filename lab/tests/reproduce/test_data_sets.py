"""Tables end to end on generated scenes that are laid out as the published data sets."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.errors import CaptureError
from desplat_ns.reproduce import grid as module
from desplat_ns.reproduce.estimate import expected_seconds
from desplat_ns.reproduce.grid import Request, reproduce, run_of
from desplat_ns.reproduce.methods import METHODS
from desplat_ns.reproduce.scenes import (
    FoundScene,
    any_scenes,
    checked,
    find_scenes,
    outputs_of,
    read_scene,
    smaller,
)
from desplat_ns.reproduce.tables import TABLES, TableName
from desplat_ns.studies import runs
from desplat_ns.studies.executors import Keep, outcome
from desplat_ns.studies.runs import Run
from desplat_ns.studies.train_and_score import train_and_score
from lab.reproduce.data_sets import write_data_sets

pytestmark = pytest.mark.usefixtures("tyro_may_build")


class InThisProcess:
    """An executor that starts no process."""

    def do(self, runs: Iterable[Run], folder: Path, keep: Keep) -> list[bool]:
        return [keep(run, outcome(run, folder)) for run in runs]


def train_here(line: list[Any], log: Path, **_: str) -> None:
    """What `runs.run_command` lets another process do."""
    results, evaluations, method, *options = map(str, line[3:])
    found = train_and_score(method, options, log.with_name("pictures"), int(evaluations))
    Path(results).write_text(json.dumps(found))


@pytest.fixture(scope="module")
def data_sets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    write_data_sets(folder)
    return folder


@pytest.fixture
def spot(data_sets: Path, tmp_path: Path) -> Path:
    """A scene of On-the-go that a test may spoil."""
    home = tmp_path / "on-the-go" / "spot"
    return shutil.copytree(data_sets / "on-the-go" / "patio_high", home)


def found_in(table: TableName, data: Path) -> dict[str, FoundScene]:
    return {one.scene.name: one for one in find_scenes(TABLES[table], data)[0]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("table", "scene", "trained", "tested"),
    [
        ("robustnerf", "Crab (2)", 6, 2),
        ("on-the-go", "Patio-High", 6, 2),
        ("A5", "Sacre Coeur", 6, 2),
        ("A6", "garden", 12, 2),  # photos 0 and 8 of 14
    ],
)
def test_each_layout_is_read_with_its_split(data_sets, table, scene, trained, tested):
    (content,) = checked([found_in(table, data_sets)[scene]], is_smoke=True).values()
    assert (content.photos, content.held_out) == (trained, tested)
    assert (content.width, content.height) == (48, 32), "smaller than a smoke run's photos already"


@pytest.mark.slow
def test_the_ratios_of_fig_9_take_as_many_cluttered_photos(data_sets):
    scenes = found_in("fig9", data_sets)
    for percent, number in ((25, 2), (75, 4)):  # round(6 / 4), to even; round(18 / 4)
        found = smaller(scenes[f"Crab (2), {percent}% cluttered"])
        names = [path.name for path in outputs_of(found, "train").image_filenames]
        assert sum("clutter" in name for name in names) == number and len(names) == 6


@pytest.mark.slow
def test_a_smoke_table_of_two_data_sets_trains_scores_and_is_written(
    data_sets, tmp_path, monkeypatch
):
    monkeypatch.setattr(runs, "run_command", train_here)
    monkeypatch.setattr(module, "SMOKE_STEPS", 4)
    data = tmp_path / "data"
    for name in ("robustnerf/yoda", "on-the-go/patio_high"):
        (data / name).parent.mkdir(parents=True)
        (data / name).symlink_to(data_sets / name)
    methods = (METHODS["desplat-paper"],)
    table, output = TABLES["A7"], tmp_path / "out"
    request = Request(table, data, output, methods, 1, InThisProcess(), 1, True, "cpu")
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
    assert conditions["versions"] and "SMOKE" in (folder / "table.md").read_text()
    assert not list(output.rglob("nerfstudio_models")), "nobody needs them"
    before = (folder / "table.md").read_bytes()
    monkeypatch.setattr(runs, "run_command", None)
    assert reproduce(request) == folder
    assert (folder / "table.md").read_bytes() == before, "all of it was done"


@pytest.mark.slow
def test_the_time_of_a_table_is_that_of_its_steps(data_sets):
    found = next(iter(checked([found_in("robustnerf", data_sets)["Yoda"]], is_smoke=True)))
    run = run_of(found, METHODS["splatfacto"], 42, is_smoke=False)
    one = expected_seconds(found, [run], "cpu")
    assert one is not None and 30_000 * 1e-3 < one < 30_000 * 10


@pytest.mark.slow
def test_a_smoke_run_takes_captures_of_any_name_and_passes_over_others(data_sets, tmp_path):
    (tmp_path / "mine").symlink_to(data_sets / "robustnerf" / "yoda")
    (tmp_path / "broken" / "images").mkdir(parents=True)
    scenes = any_scenes(TABLES["robustnerf"], tmp_path)
    assert {scene.scene.name for scene in scenes} == {"yoda", "broken"}
    assert [scene.scene.name for scene in checked(scenes, is_smoke=True)] == ["yoda"]


@pytest.mark.slow
def test_a_data_set_half_downloaded_is_refused_by_name(spot, tmp_path):
    scene = found_in("on-the-go", tmp_path)["Spot"]
    photos = sorted((spot / "images").iterdir())
    for photo in photos[::2]:
        photo.unlink()
    with pytest.raises(CaptureError, match=r"NeRF On-the-go, Spot: .*fetch the data set again"):
        read_scene(scene)


@pytest.mark.slow
def test_photos_and_their_smaller_copies_both_missing_are_an_error(spot, tmp_path):
    (spot / "images").rename(spot / "pictures")
    with pytest.raises(CaptureError, match="Spot: "):
        read_scene(found_in("on-the-go", tmp_path)["Spot"])


@pytest.mark.slow
def test_a_split_of_another_scene_is_an_error(spot, tmp_path):
    (spot / "split.json").write_text('{"clutter": [0, 900], "extra": [1]}')
    with pytest.raises(CaptureError, match=r"Take the split\.json that belongs to this scene"):
        read_scene(found_in("on-the-go", tmp_path)["Spot"])
