"""The paper's tables: every method on every scene with every seed, killed at any time; the
protocols are those of the supplement, and its figures were copied without a slip."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from desplat_ns.core.errors import CaptureError, ConfigError, DeSplatError
from desplat_ns.tools.commands.reproduce import Arguments
from desplat_ns.tools.fetch.sources import SOURCES
from desplat_ns.tools.studies import reproduce as module
from desplat_ns.tools.studies import runs
from desplat_ns.tools.studies.paper import MEAN, METHODS, TABLES, TableName, figures_of
from desplat_ns.tools.studies.records import Record
from desplat_ns.tools.studies.reproduce import Grid, Smoke, cells_of, find_contents, reproduce
from desplat_ns.tools.studies.runs import Run
from tests.helpers.made_up_runs import made_up


def contents_of(name: TableName) -> dict:
    """All scenes of a table, as if they were there."""
    content = "20 photos train, 5 test"
    places = {s: Path("/data") / s.data_set / s.folder for s in TABLES[name].scenes}
    return {replace(scene, place=place): content for scene, place in places.items()}


def grid_of(name: TableName, methods: str = "", smoke: Smoke | None = None, scenes: int = 99):
    chosen = tuple(METHODS[method] for method in methods.split() or TABLES[name].methods)
    contents = list(contents_of(name).items())
    there, missing = dict(contents[:scenes]), [scene.name for scene, _ in contents[scenes:]]
    return Grid(TABLES[name], there, missing, chosen, range(42, 44), smoke)


@pytest.fixture
def made(monkeypatch) -> Callable[..., Path]:
    """`reproduce`, which takes all scenes to be there."""
    monkeypatch.setattr(module, "find_contents", lambda table, *_: (contents_of(table.name), []))

    def make(name: TableName, output: Path, execute=made_up, **given: Any) -> Path:
        monkeypatch.setattr(runs, "execute", execute)
        options = {"seeds": 1, "smoke": None, "methods": TABLES[name].methods} | given
        methods = tuple(METHODS[method] for method in options.pop("methods"))
        places = (output.parent / "data", output)
        return reproduce(TABLES[name], *places, methods, **options)

    return make


class Counting:
    """Makes records up; may be killed on the way, or fail at some."""

    def __init__(self, most: int = 10_000, failing: str = "nothing") -> None:
        self.most, self.failing, self.done = most, failing, list[str]()

    def __call__(self, run: Run, folder: Path) -> Record:
        if len(self.done) == self.most:
            raise KeyboardInterrupt
        self.done.append(run.name)
        if self.failing in run.name:
            raise ValueError("too dark")
        return made_up(run, folder)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_runs_are_those_of_the_protocol_and_a_smoke_run_is_none_of_them():
    grid, smoke = grid_of("on-the-go"), grid_of("on-the-go", smoke=Smoke())
    assert len(grid.runs) == 6 * 3 * 2
    run = grid.runs["Patio", "splatfacto", 43]
    assert run.name == "on-the-go.patio.splatfacto-30000-43"
    assert run.parser == ("on-the-go-data", "--downscale-factor", "4")
    options = " ".join(run.options)
    assert "--pipeline.model.effects.distractors False" in options
    assert "--pipeline.evaluation.protocol full" in options, "whatever a survey finds"
    keys = [{run.key for run in each.runs.values()} for each in (grid, smoke)]
    assert not keys[0] & keys[1]


def test_a_killed_table_goes_on_and_is_the_same(made, tmp_path: Path):
    whole, killed, rest = Counting(), Counting(most=4), Counting()
    expected = files(made("A5", tmp_path / "whole", whole, seeds=2))
    with pytest.raises(KeyboardInterrupt):
        made("A5", tmp_path / "out", killed, seeds=2)
    assert files(made("A5", tmp_path / "out", rest, seeds=2)) == expected
    assert killed.done + rest.done == whole.done, "nothing is done twice"
    assert sorted(expected) == ["table.json", "table.md"]


def test_tables_of_the_same_runs_share_them(made, tmp_path: Path):
    first, second = Counting(), Counting()
    made("A7", tmp_path / "out", first)
    made("robustnerf", tmp_path / "out", second)
    assert len(first.done) == 11 * 3 and second.done == []


def test_what_fails_is_named_and_tried_again(made, tmp_path: Path):
    failing, again = Counting(failing="sacre-coeur.splatfacto-w-a"), Counting()
    with pytest.raises(DeSplatError, match="splatfacto-w-a"):
        made("A5", tmp_path / "out", failing)
    assert "too dark" in (tmp_path / "out" / "A5" / "table.md").read_text()
    made("A5", tmp_path / "out", again)
    assert len(again.done) == 1


def test_without_a_gpu_only_a_smoke_run_is_done(tmp_path: Path, monkeypatch):
    def reach(*_: Any) -> None:
        raise InterruptedError

    machine = SimpleNamespace(machine=SimpleNamespace(device_type="cpu"))
    monkeypatch.setattr("desplat_ns.tools.studies.methods.method_config", lambda method: machine)
    monkeypatch.setattr(module, "reproduce", reach)
    with pytest.raises(ConfigError, match="--smoke"):
        Arguments("A6", tmp_path).main()
    with pytest.raises(InterruptedError):
        Arguments("A6", tmp_path, smoke=True).main()


def test_missing_scenes_name_their_folder_and_what_to_type(tmp_path: Path):
    with pytest.raises(CaptureError, match=r"sacre_coeur.*desplat-fetch-data"):
        find_contents(TABLES["A5"], tmp_path)


def cells(scenes: int = 3, absent: tuple[str, int] = ("", 0)) -> dict[str, dict[str, Any]]:
    """Those of PSNR of two seeds of a method in A5, by scene."""
    psnr = {"Brandenburg Gate": 25.0, "Sacre Coeur": 20.0, "Trevi Fountain": 24.0}
    grid, records = grid_of("A5", "desplat-phototourism-paper", scenes=scenes), {}
    for (scene, _, seed), run in grid.runs.items():
        if (scene, seed) != absent:
            record = made_up(run, Path())
            records[run.key] = replace(record, scores={"psnr": psnr[scene] + seed - 42})
    return {scene: cell for (_, _, scene), cell in cells_of(grid, records).items()}


def test_the_mean_is_that_of_scenes_and_then_of_seeds_that_have_all():
    cell = cells()[MEAN]
    assert cell["values"] == [23.0, 24.0] and cell["mean"] == 23.5
    assert cell["paper"] is None, "the paper has none in A5"
    assert MEAN not in cells(scenes=2), "there is no mean of a part of the scenes"
    found = cells(absent=("Sacre Coeur", 43))
    assert found["Sacre Coeur"]["values"] == [20.0] and found[MEAN]["values"] == [23.0]


def test_the_page_has_ours_the_papers_and_the_difference(made, tmp_path: Path):
    folder = made("A7", tmp_path / "out", methods=("desplat-paper", "splatfacto"), seeds=2)
    page = (folder / "table.md").read_text()
    assert re.search(r"\| splatfacto \| 4\d\.\d\d \(paper 38\.19, \+\d\.\d\d\) \|", page)
    assert "| WildGaussians, the paper's | - | - | - | - | - | 215.64 | 480.52 |" in page
    content = json.loads((folder / "table.json").read_text())
    assert len(content["cells"]) == 2 * 2 * 12 and content["smoke"] is False
    assert content["conditions"]["seeds"] == [42, 43]
    assert content["conditions"]["devices"] == ["a device"]


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_scenes_have_downloads_and_methods_stand_beside_rows_of_figures(table):
    for scene in table.scenes:
        place = f"{scene.data_set}/{scene.folder}"
        assert place.startswith(SOURCES[scene.fetch].folder)
    figures, names = figures_of(table.name), {scene.name for scene in table.scenes}
    for row, metric in {(row, metric) for row, _, metric in figures}:
        assert {s for r, s, m in figures if (r, m) == (row, metric)} >= names
        assert metric in {known.name for known in table.metrics}
    beside = {METHODS[name].paper for name in table.methods}
    assert not figures or beside <= {row for row, _, _ in figures}
