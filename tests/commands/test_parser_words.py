"""A data parser's words behind a command's own options."""

from __future__ import annotations

from pathlib import Path

import pytest

from desplat_ns.commands import survey
from desplat_ns.commands.parser_words import parse
from desplat_ns.commands.tradeoff import Arguments
from desplat_ns.errors import ConfigError

COMMAND = "desplat-tradeoff"


def test_options_of_the_data_parser_follow_its_name():
    words = ["photos", "--time", "5min", "colmap", "--downscale-factor", "2"]
    arguments, parser = parse(Arguments, COMMAND, words)
    assert (arguments.data, arguments.time) == (Path("photos"), "5min")
    assert parser == ("colmap", "--downscale-factor", "2")
    with pytest.raises(ConfigError, match="--tiem is no option of desplat-tradeoff"):
        parse(Arguments, COMMAND, ["photos", "--tiem", "5min"])


@pytest.mark.parametrize("data", [["--data", "a"], ["--data=a"]])
def test_the_capture_is_named_as_ns_train_takes_it_too(data: list[str]):
    parser = ["colmap", "--downscale-factor", "2"]
    for words in ([*data, *parser], [*parser[:1], *data, *parser[1:]], [*parser, *data]):
        arguments, rest = parse(survey.Arguments, "desplat-survey", ["--output", "o", *words])
        assert (arguments.data, arguments.output) == (Path("a"), Path("o"))
        assert rest == tuple(parser)
    arguments, rest = parse(survey.Arguments, "desplat-survey", data)
    assert (arguments.data, rest) == (Path("a"), ())
    assert parse(Arguments, COMMAND, data)[0].data == Path("a")


@pytest.mark.parametrize("words", [["--help"], ["--time", "5min", "-h"], ["photos", "--help"]])
def test_help_is_that_of_the_command_where_no_data_parser_is_named(words, capsys):
    with pytest.raises(SystemExit) as caught:
        parse(Arguments, COMMAND, words)
    assert caught.value.code == 0
    said = capsys.readouterr()
    assert said.out.startswith("usage: desplat-tradeoff [-h]") and "--time" in said.out
    assert not said.err


@pytest.mark.usefixtures("tyro_may_build")
def test_help_behind_the_name_of_a_data_parser_is_its_own(capsys):
    with pytest.raises(SystemExit) as caught:
        parse(Arguments, COMMAND, ["photos", "robustnerf-data", "--help"])
    assert caught.value.code == 0
    said = capsys.readouterr().out
    assert said.startswith("usage: desplat-tradeoff DATA robustnerf-data")
    assert "--train-split-clean-clutter-ratio" in said
