"""Help and mistakes answer at once, and a data parser's words stand behind a command's own."""

import subprocess
import sys
from pathlib import Path

import pytest

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.tools.commands import split_words, survey, tradeoff
from desplat_ns.tools.commands.report import Report
from desplat_ns.tools.commands.reproduce import Arguments

SCRIPT = """
import sys
from importlib import import_module
name, *sys.argv = sys.argv[1:]
try:
    import_module(f"desplat_ns.tools.commands.{name}").main()
finally:
    assert not {"torch", "nerfstudio.engine.trainer"} & set(sys.modules), "a heavy import"
"""

ABSENT = ["--load-config", "absent.yml"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "arguments", "status", "words"),
    [
        ("evaluate", ABSENT, 1, "absent.yml"),
        ("report", ["--help"], 0, "--held-out-photos"),
        ("export", ["splats", *ABSENT, "--output", "a.obj"], 1, ".spz"),
        ("export", ["splats", *ABSENT, "--output", "a.ply", "--crop", "nan"], 1, "--crop"),
        ("export", ["page", *ABSENT, "--output", "a.htm"], 1, ".html"),
        ("survey", ["--help"], 0, "colmap --help"),
        ("survey", ["absent", "colmap", "--downscale-factor", "2"], 1, "'absent'"),
        ("survey", [".", "--output", "README.md"], 1, "'README.md'"),
        ("reproduce", ["--help"], 0, "--smoke"),
        ("reproduce", ["A5", "--data", "/absent"], 1, "desplat-fetch-data"),
        ("desplat", ["--bugdet", "3min", "photos"], 1, "Did you mean --budget?"),
        ("desplat", ["--tyro-print-completion", "bash"], 0, "completion"),
    ],
)
def test_help_and_mistakes_import_nothing_heavy(
    command: str, arguments: list[str], status: int, words: str, checkout: Path
):
    line = [sys.executable, "-c", SCRIPT, command, f"desplat-{command}", *arguments]
    done = subprocess.run(line, cwd=checkout, capture_output=True, text=True)
    assert words in done.stdout + done.stderr
    assert "heavy" not in done.stderr
    assert done.returncode == status


def test_options_that_cannot_be_are_named(tmp_path: Path):
    photos = tmp_path / "photos"
    for option, command in (
        ("--training-photos", Report(Path("config.yml"), training_photos=-1)),
        ("--seeds", Arguments("A5", tmp_path, seeds=0)),
        ("desplat-paper", Arguments("A5", tmp_path, methods=("desplt",))),
    ):
        with pytest.raises(ConfigError, match=option):
            command.main()
    with pytest.raises(ConfigError, match="--time"):
        tradeoff.Arguments(photos, time="soon").main(())
    with pytest.raises(CaptureError, match="photos"):
        tradeoff.Arguments(photos).main(())


@pytest.mark.parametrize("data", [["--data", "a"], ["--data=a"], ["a"]])
def test_the_capture_is_named_as_ns_train_takes_it_too(data: list[str]):
    parser = ["colmap", "--downscale-factor", "2"]
    for words in ([*data, "--output", "o", *parser], ["--output", "o", *data, *parser]):
        for command in (survey.Arguments, tradeoff.Arguments):
            arguments, rest = split_words(command, "desplat-survey", words)
            assert (arguments.data, arguments.output) == (Path("a"), Path("o"))
            assert rest == tuple(parser)


def test_an_option_that_is_not_known_is_not_taken_for_a_data_parsers():
    with pytest.raises(ConfigError, match="--tiem"):
        split_words(tradeoff.Arguments, "desplat-tradeoff", ["photos", "--tiem", "5min"])
