"""Resolved settings: all that a figure may depend on, and nothing of the machine."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from nerfstudio.configs.method_configs import AnnotatedBaseConfigUnion, all_methods

from desplat_ns.method_configs import desplat
from desplat_ns.studies.methods import method_config, parse
from lab.grid import settings
from lab.grid.settings import (
    EFFECTS,
    OF_EFFECTS,
    Settings,
    changes,
    differences,
    digest,
    resolve,
    settings_of,
)

pytestmark = pytest.mark.usefixtures("tyro_may_build")

OPTIONS = ("--max-num-iterations", "1000", "--pipeline.model.distractors.lambda-d", "0.01")
READ = ("robustnerf-data", "--downscale-factor", "2")


def test_a_method_is_parsed_as_ns_train_parses_it():
    import tyro

    ours = parse("desplat", [*OPTIONS, *READ])
    assert ours == tyro.cli(AnnotatedBaseConfigUnion, args=["desplat", *OPTIONS, *READ])


def test_settings_are_the_methods_with_the_options_and_the_schedule_of_the_run():
    settings = resolve("desplat", (*OPTIONS, *READ))
    assert settings["pipeline.model.distractors.lambda_d"] == 0.01
    assert settings["pipeline.datamanager.dataparser.downscale_factor"] == 2
    assert settings["pipeline.datamanager.dataparser._target"] == "RobustNerfDataParser"
    assert settings["pipeline.model.schedule_scale"] == pytest.approx(1 / 30)
    assert settings["optimizers.means.optimizer.lr"] == 1.6e-4
    lines: Any = all_methods["desplat"]
    assert lines.pipeline.model.schedule_scale is None, "resolving changed the method itself"


def test_a_changed_default_changes_the_settings(monkeypatch):
    before = settings_of(parse("desplat", [*OPTIONS]))
    changed: Any = copy.deepcopy(all_methods["desplat"])
    changed.pipeline.model.refinements += 1
    monkeypatch.setitem(all_methods, "desplat", changed)
    after = settings_of(parse("desplat", [*OPTIONS]))
    assert differences(before, after) == ["pipeline.model.refinements"]
    assert digest(before) != digest(after)


def test_neither_places_nor_the_machine_nor_the_seed_are_settings():
    places = ("--data", "/photos", "--output-dir", "/runs", "--machine.seed", "7")
    quiet = ("--vis", "tensorboard", "--experiment-name", "x", "--steps-per-eval-image", "0")
    config = parse("desplat", [*places, *quiet, *OPTIONS, *READ])
    config.pipeline.datamanager.data = config.data
    settings = settings_of(config)
    assert settings == resolve("desplat", (*OPTIONS, *READ))
    text = json.dumps(settings)
    assert str(Path.cwd()) not in text and "/photos" not in text


def test_a_method_that_is_not_registered_is_found_by_its_module():
    method = "lab.reproduce.baselines:by_truth"
    assert resolve(method, READ)["pipeline.model.by_truth"] is True
    assert "masked-by-truth" not in all_methods


def test_settings_come_back_from_json_as_they_were():
    settings = resolve("desplat", READ)
    assert json.loads(json.dumps(settings)) == settings
    assert settings["pipeline.datamanager.eval_image_indices"] == [0]


def test_the_same_settings_in_another_order_have_the_same_digest():
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1}) != digest({"a": 1, "b": 3})


def test_a_setting_that_one_side_lacks_is_a_difference_even_if_the_other_is_none():
    assert differences({"a": 1, "b": None}, {"a": 1}) == ["b"]
    assert differences({"a": 1}, {"a": 2, "c": 3}) == ["a", "c"]


def test_settings_of_effects_that_are_off_are_left_out():
    given = ("auto", "False"), ("distractors", "False")
    switches = [word for name, value in given for word in (f"--{EFFECTS}{name}", value)]
    off = resolve("desplat", (*switches, *READ))
    idle = ("distractors.", "appearance.", "background.")
    idle += ("optimizers.background_", "optimizers.appearance_", "optimizers.image_embeddings")
    assert not [name for name in off if name.removeprefix("pipeline.model.").startswith(idle)]
    assert off["pipeline.model.background_color"] == "random"
    lit = resolve("desplat-phototourism", ())
    prefixes = {*sum(OF_EFFECTS.values(), ())}
    assert all(any(name.startswith(prefix) for name in lit) for prefix in prefixes)


def test_the_pose_optimizer_is_no_setting_of_appearance():
    rate = "optimizers.camera_opt.optimizer.lr"
    today = {f"{EFFECTS}appearance": "off", rate: 1e-4}
    assert changes(today | {rate: 1e-2}, today) == [rate]


def test_older_records_that_hold_them_are_compared_without_them():
    today = {f"{EFFECTS}distractors": False, "a": 1}
    older = today | {"pipeline.model.distractors.lambda_d": 0.1}
    assert changes(older, today) == changes(today, older) == []


def test_an_effect_that_is_switched_is_one_change():
    off: Settings = {f"{EFFECTS}distractors": False}
    on: Settings = {f"{EFFECTS}distractors": True, "pipeline.model.distractors.lambda_d": 0.1}
    assert changes(off, on) == changes(on, off) == [f"{EFFECTS}distractors"]
    other = on | {"pipeline.model.distractors.lambda_d": 0.2}
    assert changes(on, other) == ["pipeline.model.distractors.lambda_d"]


def test_a_name_that_a_record_lacks_counts_unless_todays_value_is_neutral(monkeypatch):
    monkeypatch.setattr(settings, "NEUTRAL", {"new": 0.0})
    assert changes({"a": 1}, {"a": 1, "new": 0.0}) == []
    assert changes({"a": 1}, {"a": 1, "new": 0.5}) == ["new"]
    assert changes({"a": 1, "new": 0.5}, {"a": 1, "new": 0.0}) == ["new"]
    assert changes({"a": 1, "gone": 0}, {"a": 1}) == ["gone"]
    assert changes({"a": 1}, {"a": 1, "other": 0.0}) == ["other"]


def test_an_option_that_does_not_exist_is_refused(capsys):
    with pytest.raises(SystemExit):
        resolve("desplat", ("--no-such-option", "1"))


def test_the_registered_method_is_the_packages():
    assert method_config("desplat") == desplat.config


def test_what_makes_a_region_does_not_matter_where_distractors_start_everywhere():
    everywhere, residual = resolve("desplat-paper", ()), resolve("desplat", ())
    begun = everywhere | {"pipeline.model.distractors.static_warmup": 600}
    for base, expected in (
        (everywhere, []),
        (begun, ["shaping_steps"]),
        (residual, ["shaping_steps", "strong_excess"]),
    ):
        other = base | {
            "pipeline.model.distractors.strong_excess": 0.5,
            "pipeline.model.distractors.shaping_steps": 1,
        }
        assert [name.rsplit(".")[-1] for name in changes(other, base)] == expected
