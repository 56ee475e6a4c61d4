"""A record holds what its figures are of, and is stale once the settings are others."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from nerfstudio.configs.method_configs import all_methods

from desplat_ns.studies.machine import DIRTY
from lab.grid import settings as grid_settings
from lab.grid.captures import RealCapture
from lab.grid.records import Record, State, enter, load, save, state_of
from lab.grid.runs import Run, Scene, Setting, Study

pytestmark = pytest.mark.usefixtures("tyro_may_build")

GIVEN = ("--pipeline.model.effects.auto", "False")
OFF = (*GIVEN, "--pipeline.model.effects.distractors", "False")
SETTINGS = {"ours": Setting("desplat", GIVEN), "off": Setting("desplat", OFF)}
SCENES = {"fox": Scene(RealCapture("fox"), ("colmap",))}
PLAN = tuple(Run(name, "fox", 2, 1000, seed) for seed in (42, 43) for name in SETTINGS)
STUDY = Study(SETTINGS, SCENES, PLAN, ("psnr",))
OURS, WITHOUT = PLAN[0], PLAN[1]
COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Records of a method and of it without distractors, as today's code resolves both."""
    path = tmp_path / "records.json"
    for run in (OURS, WITHOUT):
        enter(path, run, Record({"psnr": 25.0}, COMMIT, STUDY.settings_of(run)))
    return path


def change_default(monkeypatch, name: str, value: Any) -> None:
    """As an edit of the method would: what was resolved before is forgotten."""
    changed: Any = copy.deepcopy(all_methods["desplat"])
    assert getattr(changed.pipeline.model, name) != value
    setattr(changed.pipeline.model, name, value)
    monkeypatch.setitem(all_methods, "desplat", changed)
    grid_settings._resolved.cache_clear()


@pytest.fixture(autouse=True)
def forget_what_was_resolved():
    yield
    grid_settings._resolved.cache_clear()


def test_records_come_back_as_they_were_entered(file: Path):
    entries = load(file)
    assert entries[OURS.name] == Record({"psnr": 25.0}, COMMIT, STUDY.settings_of(OURS))
    assert entries[WITHOUT.name].settings == STUDY.settings_of(WITHOUT)


def test_a_curve_comes_back_and_takes_no_place_where_there_is_none(file: Path):
    assert "curve" not in file.read_text()
    bent = replace(load(file)[OURS.name], curve=({"step": 5, "psnr": 20.0},))
    enter(file, OURS, bent)
    assert load(file)[OURS.name] == bent and load(file)[WITHOUT.name].curve == ()


def test_a_run_is_done_until_a_default_changes(file: Path, monkeypatch):
    assert state_of(STUDY, OURS, load(file)) == (State.DONE, [])
    change_default(monkeypatch, "refinements", 99)
    assert state_of(STUDY, OURS, load(file)) == (State.STALE, ["pipeline.model.refinements"])


def test_a_changed_option_of_its_setting_makes_it_stale(file: Path, monkeypatch):
    monkeypatch.setitem(SETTINGS, "ours", SETTINGS["off"])
    changed = ["pipeline.model.effects.distractors"]
    assert state_of(STUDY, OURS, load(file)) == (State.STALE, changed)


def test_a_changed_scene_makes_it_stale_and_a_record_without_one_is_not(file: Path, monkeypatch):
    records, settings = load(file), STUDY.settings_of(OURS)
    assert settings["scene.folder"] == "fox"
    monkeypatch.setitem(SCENES, "fox", Scene(RealCapture("badger"), ("colmap",)))
    assert state_of(STUDY, OURS, records) == (State.STALE, ["scene.folder"])
    del settings["scene.folder"]
    records[OURS.name] = Record({"psnr": 1.0}, COMMIT, settings)
    assert state_of(STUDY, OURS, records) == (State.DONE, [])


def test_code_that_was_not_committed_is_a_state_of_its_own(file: Path):
    settings = STUDY.settings_of(OURS)
    enter(file, OURS, Record({"psnr": 25.0}, COMMIT + DIRTY, settings))
    assert state_of(STUDY, OURS, load(file)) == (State.DIRTY, [])
    other = settings | {"max_skipped_steps": 1}
    enter(file, OURS, Record({"psnr": 25.0}, COMMIT + DIRTY, other))
    assert state_of(STUDY, OURS, load(file)) == (State.STALE, ["max_skipped_steps"])


def test_device_and_backend_are_kept_and_compared_where_the_study_names_them(file: Path):
    record = replace(load(file)[OURS.name], device="cuda", backend="gsplat")
    enter(file, OURS, record)
    records = load(file)
    assert records[OURS.name] == record
    assert state_of(STUDY, OURS, records) == (State.DONE, [])
    assert state_of(replace(STUDY, device="cuda"), OURS, records) == (State.DONE, [])
    assert state_of(replace(STUDY, device="cpu"), OURS, records) == (State.ELSEWHERE, ["device"])
    assert state_of(replace(STUDY, device="cpu"), WITHOUT, records)[0] is State.ELSEWHERE


def test_a_run_that_was_never_done_is_missing(file: Path):
    assert state_of(STUDY, PLAN[2], load(file)) == (State.MISSING, [])
    assert load(file.with_name("nowhere.json")) == {}


def test_a_record_without_settings_is_no_evidence(tmp_path: Path):
    records = {OURS.name: Record({"psnr": 1.0}, None, None)}
    save(tmp_path / "r.json", records)
    assert load(tmp_path / "r.json") == records
    assert state_of(STUDY, OURS, records) == (State.UNKNOWN, [])


def test_the_file_keeps_each_settings_once_and_only_what_differs_apart(file: Path):
    same_but_for_the_seed = PLAN[2]
    settings = STUDY.settings_of(same_but_for_the_seed)
    enter(file, same_but_for_the_seed, Record({"psnr": 24.0}, COMMIT, settings))
    content = json.loads(file.read_text())
    assert len(content["settings"]) == 3  # what is common, and two settings
    parts = [part for name, part in content["settings"].items() if name != "common"]
    switch = "pipeline.model.effects.distractors"
    off, ours = sorted(parts, key=len)
    assert off == {switch: False} and ours[switch] is True
    assert {name for name in ours if "distractor" not in name} == set()


def test_settings_that_no_record_has_any_more_go(file: Path):
    settings = STUDY.settings_of(OURS)
    enter(file, WITHOUT, Record({"psnr": 25.0}, COMMIT, settings))
    assert json.loads(file.read_text())["settings"].keys() == {
        "common",
        grid_settings.digest(settings),
    }
    assert load(file)[OURS.name].settings == settings


def test_an_entry_replaces_the_one_of_its_run_alone(file: Path):
    enter(file, OURS, Record({"psnr": 26.0}, "desplat-ns 9", {"a": 1}))
    entries = load(file)
    assert entries[OURS.name] == Record({"psnr": 26.0}, "desplat-ns 9", {"a": 1})
    assert entries[WITHOUT.name].figures == {"psnr": 25.0}
