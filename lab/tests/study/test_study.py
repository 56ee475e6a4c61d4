"""The study: its runs can be done, go on where they were stopped, and end up in one table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from desplat_ns.tools.studies.methods import parse
from desplat_ns.tools.studies.records import Record, load
from desplat_ns.tools.studies.runs import Run
from lab.study import __main__ as study
from lab.study.captures import CAPTURES, made
from lab.study.variants import GROUPS, run_of

PSNR = {"off": 20.0, "twins": 30.0, "desplat": 26.0, "truth": 27.0}


def made_up(run: Run, folder: Path) -> Record:
    """PSNR by variant and seed."""
    assert run.data.is_dir(), "what is generated is there"
    psnr = PSNR[run.name.partition("-")[0]] + run.seed - 42
    return Record("c" * 40, "2026-11-27", *run.key, {"psnr": psnr}, 9.0, "a CPU")


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The study's command with made-up runs, in a folder of its own; nothing is drawn."""
    empty = {
        name: replace(capture, locate=lambda folder: made(folder / "photos", Path.mkdir))
        for name, capture in CAPTURES.items()
        if name != "fox_cluttered"
    }
    monkeypatch.setattr(study, "do", made_up)
    monkeypatch.setattr(study, "CAPTURES", CAPTURES | empty)
    monkeypatch.delenv("DESPLAT_NS_DATA", raising=False)

    def call(*words: str) -> int:
        places = ("--records", str(tmp_path / "r.jsonl"), "--output", str(tmp_path / "out"))
        return study.main([*words, *places])

    return call


def test_runs_are_done_once_and_the_table_has_their_medians(command, tmp_path: Path, capsys):
    assert command("--only", "*-other-table20", "--jobs", "2") == 0
    table = (tmp_path / "out" / "table.md").read_text()
    ours = (
        "| other-table20 | **`desplat`** | 3,000 | 3 | 0.60 (0.60 - 0.60) | 27.00 (26.00 - 28.00) |"
    )
    assert ours in table
    assert "ccccccc (12)" in table and "a CPU (12)" in table and "--only '*-other-table20'" in table
    records = load(tmp_path / "r.jsonl")
    capsys.readouterr()
    assert command("--only", "*-other-table20", "--list") == 0
    assert capsys.readouterr().out.strip() == ""
    assert command("--only", "*-other-table20") == 0 and load(tmp_path / "r.jsonl") == records


def test_a_capture_that_is_not_there_leaves_the_others(command, tmp_path: Path, capsys):
    assert command("--only", "desplat-fox_cluttered", "desplat-facade8") == 1
    assert {record.capture for record in load(tmp_path / "r.jsonl").values()} == {"facade8"}
    assert "DESPLAT_NS_DATA" in capsys.readouterr().err


@pytest.mark.usefixtures("tyro_may_build")
@pytest.mark.parametrize("group", GROUPS)
def test_every_run_is_there_once_and_its_method_takes_its_options(group: str):
    runs = [run_of(*wanted) for wanted in dict.fromkeys(GROUPS[group])]
    assert len({run.key for run in runs}) == len(runs)
    for run in {run.name: run for run in runs if run.seed == 42}.values():
        if run.variant.endswith(("other-table20", "sacre_coeur", "fox")):
            parse(run.method, ["--data", "photos", *run.given])


def test_what_is_made_is_whole(tmp_path: Path):
    def fails(path: Path) -> None:
        path.mkdir()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "scene", fails)
    assert not (tmp_path / "scene").exists()
    assert made(tmp_path / "scene", Path.mkdir).is_dir()
    assert made(tmp_path / "scene", fails).is_dir(), "it is there"
