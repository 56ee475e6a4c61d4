"""Every method on every scene with every seed; killed at any time, it gives the same table."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.errors import CaptureError, ConfigError, DeSplatError
from desplat_ns.reproduce import grid as module
from desplat_ns.reproduce.grid import Grid, Request, open_grid, reproduce
from desplat_ns.reproduce.methods import METHODS
from desplat_ns.reproduce.paper import MEAN
from desplat_ns.reproduce.protocols import Smoke
from desplat_ns.reproduce.scenes import FoundScene
from desplat_ns.reproduce.tables import TABLES, TableName
from desplat_ns.reproduce.writing import SMOKE, cells_of
from desplat_ns.studies.executors import Executor, open_records
from desplat_ns.studies.methods import Content
from desplat_ns.studies.records import Record
from desplat_ns.studies.runs import Run
from tests.helpers.made_up_runs import made_up

CONTENT = Content(photos=20, held_out=5, width=100, height=80)


def request_of(
    name: TableName, output: Path, do=made_up, methods: str = "", **given: Any
) -> Request:
    table = TABLES[name]
    taken = tuple(METHODS[method] for method in methods.split() or table.methods)
    request = Request(table, output.parent / "data", output, taken, 1, Executor(do=do), "cuda")
    return replace(request, **given)


def grid_of(request: Request) -> Grid:
    """All scenes of its table, as if they were there."""
    contents = {
        FoundScene(protocol, scene, Path("/data") / protocol.folder / scene.folder): CONTENT
        for protocol in request.table.protocols
        for scene in protocol.scenes
    }
    return Grid(request, contents, open_records(request.output), [])


@pytest.fixture(autouse=True)
def unread(monkeypatch):
    """`reproduce` takes all scenes to be there."""
    monkeypatch.setattr(module, "open_grid", grid_of)


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


def test_runs_are_those_of_the_protocol(tmp_path: Path):
    grid = grid_of(request_of("on-the-go", tmp_path, seeds=2))
    assert len(grid.runs) == 6 * 3 * 2
    run = grid.runs["Patio", "splatfacto", 43]
    assert run.name == "on-the-go.patio.splatfacto-30000-43"
    assert run.parser == ("on-the-go-data", "--downscale-factor", "4")
    options = " ".join(run.options)
    assert "--pipeline.model.effects.distractors False" in options
    assert "--pipeline.evaluation.protocol full" in options, "whatever a survey finds"


def test_a_smoke_run_is_no_run_of_the_table(tmp_path: Path):
    real, smoke = (request_of("A6", tmp_path, smoke=smoke) for smoke in (None, Smoke()))
    keys = [{run.key for run in grid_of(request).runs.values()} for request in (real, smoke)]
    assert not keys[0] & keys[1] and real.folder != smoke.folder


def test_a_killed_table_goes_on_and_is_the_same(tmp_path: Path):
    whole, killed, rest = Counting(), Counting(most=4), Counting()
    expected = files(reproduce(request_of("A5", tmp_path / "whole", whole, seeds=2)))
    with pytest.raises(KeyboardInterrupt):
        reproduce(request_of("A5", tmp_path / "out", killed, seeds=2))
    assert files(reproduce(request_of("A5", tmp_path / "out", rest, seeds=2))) == expected
    assert killed.done + rest.done == whole.done, "nothing is done twice"
    assert sorted(expected) == ["table.json", "table.md"]


def test_tables_of_the_same_runs_share_them(tmp_path: Path):
    first, second = Counting(), Counting()
    reproduce(request_of("A7", tmp_path / "out", first))
    folder = reproduce(request_of("A9", tmp_path / "out", second))
    assert len(first.done) == 11 * 3 and second.done == []
    assert "100.00 (paper 101.86, -1.86)" in (folder / "table.md").read_text()


def test_what_fails_is_named_and_tried_again(tmp_path: Path):
    failing, again = Counting(failing="sacre_coeur.splatfacto-w-a"), Counting()
    request = request_of("A5", tmp_path / "out", failing)
    with pytest.raises(DeSplatError, match=r"1 of 18 .*splatfacto-w-a"):
        reproduce(request)
    assert "too dark" in (request.folder / "table.md").read_text()
    reproduce(request_of("A5", tmp_path / "out", again))
    assert len(again.done) == 1


def test_without_a_gpu_only_a_smoke_run_is_done(tmp_path: Path):
    executor = Counting()
    with pytest.raises(ConfigError, match="--smoke"):
        reproduce(request_of("A6", tmp_path / "out", executor, device="cpu"))
    assert executor.done == []
    reproduce(request_of("A6", tmp_path / "out", executor, device="cpu", smoke=Smoke()))
    assert len(executor.done) == 21


def test_weights_of_lpips_that_are_missing_are_said_before_anything_is_run(
    tmp_path: Path, monkeypatch, capsys
):
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    reproduce(request_of("A6", tmp_path / "out", smoke=Smoke()))
    assert "alexnet-owt-7be5be79.pth" in " ".join(capsys.readouterr().out.split())
    reproduce(request_of("A8", tmp_path / "out", smoke=Smoke()))
    assert "LPIPS" not in capsys.readouterr().out, "no figure of that table"


def test_missing_scenes_name_their_folder_and_what_to_type(tmp_path: Path):
    request = request_of("A5", tmp_path / "out")
    with pytest.raises(CaptureError, match="There is no folder"):
        open_grid(request)
    request.data.mkdir()
    with pytest.raises(CaptureError, match=r"sacre_coeur.*desplat-fetch-data .*--folder"):
        open_grid(request)


# --- what is written -----------------------------------------------------------------------------


def psnr(scene: str, seed: int) -> float:
    of_scene = {"Brandenburg Gate": 25.0, "Sacre Coeur": 20.0, "Trevi Fountain": 24.0}
    return of_scene[scene] + seed - 42


Cells = Callable[..., dict[str, dict[str, Any]]]


@pytest.fixture
def cells(tmp_path: Path) -> Cells:
    """Those of PSNR of two seeds, by scene."""

    def made(scenes: int = 3, absent: tuple[str, int] = ("", 0), **given: Any):
        request = request_of("A5", tmp_path / "c", methods="desplat-phototourism-paper", **given)
        grid = grid_of(replace(request, seeds=2))
        grid.contents = dict(list(grid.contents.items())[:scenes])
        for (scene, _, seed), run in grid.runs.items():
            record = made_up(run, tmp_path)
            if (scene, seed) != absent:
                grid.records[run.key] = replace(record, scores={"psnr": psnr(scene, seed)})
        return {cell["scene"]: cell for cell in cells_of(grid)}

    return made


def test_a_figure_is_the_mean_of_seeds_beside_the_papers(cells: Cells):
    cell = cells()["Sacre Coeur"]
    assert cell["values"] == [20.0, 21.0] and cell["mean"] == 20.5
    assert cell["paper"] == 20.14 and cell["difference"] == pytest.approx(0.36)


def test_the_mean_is_that_of_scenes_and_then_of_seeds(cells: Cells):
    cell = cells()[MEAN]
    assert cell["values"] == [23.0, 24.0] and cell["mean"] == 23.5
    assert cell["paper"] is None, "the paper has none in A5"
    assert MEAN not in cells(scenes=2), "there is no mean of a part of the scenes"


def test_a_seed_without_a_scene_is_in_no_mean(cells: Cells):
    found = cells(absent=("Sacre Coeur", 43))
    assert found["Sacre Coeur"]["values"] == [20.0] and found[MEAN]["values"] == [23.0]


def test_the_page_has_ours_the_papers_and_the_difference(tmp_path: Path):
    request = request_of("A8", tmp_path / "out", methods="desplat-paper splatfacto")
    folder = reproduce(replace(request, seeds=2))
    page = (folder / "table.md").read_text()
    assert "| splatfacto | 50:00 (paper 9:32, +40:28) |" in page
    assert "| WildGaussians, the paper's | - | - | - | - | - | 58:06 | 80:30 |" in page
    for condition in ("seeds: 42, 43", "steps: 30000", "devices: a device", "mean of scenes"):
        assert condition in page
    content = json.loads((folder / "table.json").read_text())
    assert len(content["cells"]) == 2 * 12 and content["smoke"] is False


def test_a_smoke_table_says_so_and_has_nothing_of_the_papers(tmp_path: Path, cells: Cells):
    folder = reproduce(request_of("A8", tmp_path / "out", smoke=Smoke()))
    page = (folder / "table.md").read_text()
    assert SMOKE in page and "(paper" not in page and "9:32" not in page
    assert all(cell["paper"] is None for cell in cells(smoke=Smoke()).values())
