"""Every method on every scene with every seed; killed at any time, it gives the same table."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from desplat_ns.errors import CaptureError, ConfigError, DeSplatError
from desplat_ns.reproduce import grid as module
from desplat_ns.reproduce.grid import Grid, open_grid, reproduce
from desplat_ns.reproduce.records import FILE, Records
from desplat_ns.reproduce.writing import write_table
from tests.helpers.reproduced import MadeUpExecutor, grid_of, request_of


@pytest.fixture
def unread(monkeypatch):
    """Scenes are taken to be there, and nothing is timed."""
    monkeypatch.setattr(module, "open_grid", grid_of)
    monkeypatch.setattr(module, "_check_disk", lambda grid: None)
    monkeypatch.setattr(module, "expected_seconds", lambda *_: 7200.0)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_runs_are_those_of_the_protocol():
    grid = grid_of(request_of("on-the-go", Path("absent"), MadeUpExecutor(), seeds=2))
    assert len(grid.runs) == 6 * 3 * 2
    run = grid.runs["Patio", "splatfacto", 43]
    assert run.name == "on-the-go.patio.splatfacto-30000-43"
    assert run.parser == ("on-the-go-data", "--downscale-factor", "4")
    options = " ".join(run.options)
    assert "--pipeline.model.effects.distractors False" in options
    assert "--pipeline.evaluation.protocol full" in options, "whatever a survey finds"
    assert "--pipeline.evaluation.lpips-net alex" in options


def test_a_smoke_run_has_other_names_and_folders_than_the_real_one():
    real, smoke = (
        request_of("A6", Path("out"), MadeUpExecutor(), is_smoke=smoke) for smoke in (False, True)
    )
    names = [{run.name for run in grid_of(request).runs.values()} for request in (real, smoke)]
    assert not names[0] & names[1] and real.folder != smoke.folder


def test_a_killed_table_goes_on_and_is_the_same(tmp_path: Path, unread):
    whole, killed = MadeUpExecutor(), MadeUpExecutor(most=4)
    expected = files(reproduce(request_of("A5", tmp_path / "whole", whole, seeds=2)))
    with pytest.raises(KeyboardInterrupt):
        reproduce(request_of("A5", tmp_path / "out", killed, seeds=2))
    rest = MadeUpExecutor()
    assert files(reproduce(request_of("A5", tmp_path / "out", rest, seeds=2))) == expected
    assert killed.done + rest.done == whole.done, "nothing is done twice"


def test_tables_of_the_same_runs_share_them(tmp_path: Path, unread):
    first, second = MadeUpExecutor(), MadeUpExecutor()
    reproduce(request_of("A7", tmp_path / "out", first))
    folder = reproduce(request_of("A9", tmp_path / "out", second))
    assert len(first.done) == 11 * 3 and second.done == []
    assert "100.00 (paper 101.86, -1.86)" in (folder / "table.md").read_text()


def test_what_fails_is_named_and_tried_again(tmp_path: Path, unread):
    request = request_of(
        "A5", tmp_path / "out", MadeUpExecutor(failing="sacre_coeur.splatfacto-w-a")
    )
    with pytest.raises(DeSplatError, match=r"1 of 18 runs failed: .*splatfacto-w-a"):
        reproduce(request)
    assert "too dark" in (request.folder / "table.md").read_text()
    again = MadeUpExecutor()
    reproduce(request_of("A5", tmp_path / "out", again))
    assert len(again.done) == 1


def test_without_a_gpu_it_says_how_long_it_would_take(tmp_path: Path, unread):
    executor = MadeUpExecutor()
    with pytest.raises(ConfigError, match=r"no GPU.*about 2 h here.*--smoke"):
        reproduce(request_of("A6", tmp_path / "out", executor, device="cpu"))
    assert executor.done == []
    reproduce(request_of("A6", tmp_path / "out", executor, device="cpu", is_smoke=True))
    assert len(executor.done) == 21


def test_weights_of_lpips_that_are_missing_are_said_before_anything_is_run(
    tmp_path: Path, unread, monkeypatch, capsys
):
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    reproduce(request_of("A6", tmp_path / "out", MadeUpExecutor(), is_smoke=True))
    said = " ".join(capsys.readouterr().out.split())
    assert "LPIPS's weights are not at" in said and "alexnet-owt-7be5be79.pth" in said
    reproduce(request_of("A8", tmp_path / "out", MadeUpExecutor(), is_smoke=True))
    assert "LPIPS" not in capsys.readouterr().out, "no figure of that table"


def test_missing_scenes_name_their_folder_and_what_to_type(tmp_path: Path):
    request = request_of("A5", tmp_path / "out", MadeUpExecutor())
    with pytest.raises(CaptureError, match="There is no folder"):
        open_grid(request)
    request.data.mkdir()
    said = "phototourism/sacre_coeur.*desplat-fetch-data sacre-coeur --folder"
    with pytest.raises(CaptureError, match=said):
        open_grid(request)


@pytest.mark.parametrize(
    ("inside", "said"), [("images", "single capture"), ("a/b/crab1", "perhaps")]
)
def test_a_folder_of_a_wrong_level_is_noticed(tmp_path: Path, inside: str, said: str):
    request = request_of("robustnerf", tmp_path / "out", MadeUpExecutor())
    (request.data / inside).mkdir(parents=True)
    with pytest.raises(CaptureError, match=said):
        open_grid(request)


def test_a_folder_that_cannot_be_written_is_an_error(tmp_path: Path):
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="is a file"):
        reproduce(request_of("A5", tmp_path / "file", MadeUpExecutor()))


def test_a_folder_with_something_else_is_refused(tmp_path: Path):
    (tmp_path / "photo.png").touch()
    with pytest.raises(ConfigError, match="no table's"):
        Records.load(tmp_path)


def kept(tmp_path: Path) -> Grid:
    grid = grid_of(request_of("A5", tmp_path, MadeUpExecutor(), methods=("splatfacto",)))
    grid.do()
    return grid


def test_records_of_other_code_or_options_are_refused(tmp_path: Path):
    grid, path = kept(tmp_path), tmp_path / FILE
    write_table(grid.request.folder, grid.results())
    content = json.loads(path.read_text())
    next(iter(content["done"].values()))["asked"][1] = "/elsewhere"
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=r"that was another: .*/elsewhere"):
        grid_of(grid.request).left()
    path.write_text(json.dumps(content | {"code": "c0ffee"}))
    with pytest.raises(ConfigError, match="holds runs by c0ffee"):
        Records.load(tmp_path)
    path.write_text("{")
    with pytest.raises(ConfigError, match="is damaged"):
        Records.load(tmp_path)


def test_records_come_back_as_they_were(tmp_path: Path):
    assert Records.load(tmp_path / "absent").done == {}
    assert kept(tmp_path).records == Records.load(tmp_path)
