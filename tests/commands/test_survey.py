from __future__ import annotations

import json
from pathlib import Path

import pytest

from desplat_ns.commands.parser_words import parse
from desplat_ns.commands.survey import Arguments
from desplat_ns.commands.surveyed import survey_capture
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.errors import CaptureError, ConfigError
from tests.helpers.quick_command import check_quick_command


@pytest.mark.slow
def test_a_capture_is_found_and_the_findings_are_written(tiny_scene, tmp_path, capsys):
    findings = survey_capture(tiny_scene.folder, tmp_path / "out")
    assert "It is read by robustnerf-data." in capsys.readouterr().out
    written = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert written["appearance"]["decision"] == findings.appearance.decision
    assert (tmp_path / "out" / "survey.png").stat().st_size > 1000


def test_a_data_parser_chooses_the_photos(tiny_scene, tmp_path):
    parser = RobustNerfDataParserConfig(train_split_clean_clutter_ratio=0.0)
    findings = survey_capture(tiny_scene.folder, tmp_path, parser)
    assert findings.num_photos == tiny_scene.spec.num_views
    assert parser.data == tiny_scene.folder


@pytest.mark.usefixtures("tyro_may_build")
def test_the_command_takes_a_parser_by_its_name(tiny_scene, tmp_path):
    for parser in ("colmap", "robustnerf-data"):
        folder = str(tiny_scene.folder)
        options = ["--output", str(tmp_path / parser), "--overwrite"]
        for given in (
            [folder, *options, parser],
            [*options, parser, "--data", folder],
            ["--data", folder, *options, parser],
            [*options, f"--data={folder}"],
        ):
            arguments, rest = parse(Arguments, "desplat-survey", given)
            findings = arguments.survey(rest)
            assert findings.num_photos > 0
        assert (tmp_path / parser / "survey.json").is_file()


@pytest.mark.parametrize("name", ["survey.json", "survey.png"])
def test_findings_that_are_there_are_replaced_only_if_that_is_asked_for(
    tiny_scene, tmp_path, name: str
):
    (tmp_path / name).write_text("before")
    arguments = Arguments(tiny_scene.folder, tmp_path)
    with pytest.raises(ConfigError, match=rf"{name}' already.*--overwrite"):
        arguments.survey(())
    assert [path.read_text() for path in tmp_path.iterdir()] == ["before"]
    arguments.overwrite = True
    arguments.survey(())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["survey.json", "survey.png"]
    assert (tmp_path / name).read_bytes() != b"before"


def test_findings_that_cannot_be_written_whole_leave_the_earlier_ones(
    tiny_scene, tmp_path, monkeypatch: pytest.MonkeyPatch
):
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "survey.json").write_text("before")
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(ConfigError, match=r"No space left.*--output"):
        survey_capture(tiny_scene.folder, tmp_path)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["before"]


def test_mistakes_say_what_to_do(tiny_scene, tmp_path):
    with pytest.raises(CaptureError, match=r"The folder .* is empty"):
        survey_capture(tmp_path, tmp_path / "out")
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="--output"):
        survey_capture(tiny_scene.folder, tmp_path / "file")


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["--help"], 0, "desplat-survey DATA colmap --help"),
        (["absent"], 1, "Error: There is no 'absent'. Name the folder of a capture."),
        (["absent", "colmap", "--downscale-factor", "2"], 1, "There is no 'absent'"),
        (
            [".", "--output", "README.md"],
            1,
            "'README.md' is a file; --output names something in it",
        ),
        ([".", "--tiem", "5"], 1, "--tiem is no option of desplat-survey"),
        ([], 1, "Type: desplat-survey FOLDER"),
    ],
)
def test_help_and_mistakes_import_nothing_heavy(
    arguments: list[str], status: int, words: str, checkout: Path
):
    check_quick_command("survey", arguments, status, words, checkout)
