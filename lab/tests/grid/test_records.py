"""Records come back as they were entered, and nothing but a record's absence asks for its run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from desplat_ns.studies.machine import DIRTY
from lab.grid.captures import RealCapture
from lab.grid.records import Record, enter, is_done, load
from lab.grid.runs import Run, Scene, Setting, Study

SETTINGS = {"ours": Setting("desplat", ("--visits", "9")), "off": Setting("desplat")}
STUDY = Study(SETTINGS, {"fox": Scene(RealCapture("fox"), ("colmap",))}, (), ("psnr",))
OURS, WITHOUT = (Run(name, "fox", 2, 1000, 42) for name in SETTINGS)
COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Records of two runs."""
    path = tmp_path / "records.json"
    for run in (OURS, WITHOUT):
        enter(path, run, Record({"psnr": 25.0}, COMMIT, STUDY.given_of(run), "cuda", "gsplat"))
    return path


def test_records_come_back_as_they_were_entered(file: Path):
    given = "desplat --visits 9 colmap --downscale-factor 2"
    assert load(file)[OURS.name] == Record({"psnr": 25.0}, COMMIT, given, "cuda", "gsplat")
    assert load(file.with_name("nowhere.json")) == {}


def test_a_record_is_a_line_of_json(file: Path):
    _, *lines, _ = file.read_text().splitlines()
    assert len(lines) == 2 and all(json.loads(f"{{{line.rstrip(',')}}}") for line in lines)


def test_a_curve_comes_back_and_takes_no_place_where_there_is_none(file: Path):
    assert "curve" not in file.read_text()
    bent = replace(load(file)[OURS.name], curve=({"step": 5, "psnr": 20.0},))
    enter(file, OURS, bent)
    assert load(file)[OURS.name] == bent and load(file)[WITHOUT.name].curve == ()


def test_an_entry_replaces_the_one_of_its_run_alone(file: Path):
    enter(file, OURS, Record({"psnr": 26.0}, "desplat-ns 9"))
    entries = load(file)
    assert entries[OURS.name] == Record({"psnr": 26.0}, "desplat-ns 9")
    assert entries[WITHOUT.name].figures == {"psnr": 25.0}


def test_a_run_is_done_once_committed_code_has_a_record_whatever_it_was_given(file: Path):
    assert is_done(OURS, load(file)) and not is_done(replace(OURS, seed=43), load(file))
    enter(file, OURS, Record({"psnr": 25.0}, COMMIT, "desplat --visits 8"))
    assert is_done(OURS, load(file))
    enter(file, OURS, Record({"psnr": 25.0}, COMMIT + DIRTY))
    assert not is_done(OURS, load(file))
