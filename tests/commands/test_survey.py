from __future__ import annotations

import json
from dataclasses import asdict

import pytest
import tyro

from desplat_ns.commands.survey import survey_capture
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.effects import Effects
from desplat_ns.errors import CaptureError, ConfigError


def test_a_capture_is_found_and_the_findings_are_written(tiny_scene, tmp_path, capsys):
    found = survey_capture(tiny_scene.folder, tmp_path / "out")
    assert "It is read by robustnerf-data." in capsys.readouterr().out
    written = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert written["distractors"]["decision"] == found.distractors.decision
    assert (tmp_path / "out" / "survey.png").stat().st_size > 1000
    steps = written["on_this_machine"]["steps"]
    assert steps[0]["ratio"] == 1 and steps[0]["effects"] == asdict(Effects(distractors=False))
    assert steps[-1]["effects"] == found.decisions()
    assert all(step["milliseconds"] > 0 for step in steps)


def test_a_data_parser_chooses_the_photos(tiny_scene, tmp_path):
    parser = RobustNerfDataParserConfig(train_split_clean_clutter_ratio=0.0)
    found = survey_capture(tiny_scene.folder, tmp_path, False, parser)
    assert found.num_photos == tiny_scene.spec.num_views
    assert parser.data == tiny_scene.folder


@pytest.mark.usefixtures("tyro_may_build")
def test_the_command_takes_a_parser_by_its_name(tiny_scene, tmp_path):
    for parser in ("colmap", "robustnerf-data"):
        arguments = [str(tiny_scene.folder), "--output", str(tmp_path / parser)]
        arguments += ["--no-measure-costs", parser]
        found = tyro.cli(survey_capture, args=[*arguments, "--data", str(tiny_scene.folder)])
        assert found.num_photos > 0
        assert (tmp_path / parser / "survey.json").is_file()


def test_mistakes_say_what_to_do(tiny_scene, tmp_path):
    with pytest.raises(CaptureError, match=r"The folder .* is empty"):
        survey_capture(tmp_path)
    with pytest.raises(ConfigError, match="desplat-survey FOLDER"):
        survey_capture()
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="--output"):
        survey_capture(tiny_scene.folder, tmp_path / "file")
