"""`desplat-reproduce` as its user meets it: help, and its refusals."""

from __future__ import annotations

from pathlib import Path

import pytest

from desplat_ns.commands.reproduce import Arguments
from desplat_ns.errors import CaptureError, ConfigError
from tests.helpers.quick_command import check_quick_command


def test_help_and_mistakes_answer_at_once(checkout: Path):
    check_quick_command("reproduce", ["--help"], 0, "--smoke", checkout)
    check_quick_command("reproduce", ["A5", "--data", "/absent"], 1, "fetch-data", checkout)


def test_an_unknown_method_lists_those_there_are(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"'desplt'.*desplat-paper.*module:attribute"):
        Arguments("A5", tmp_path, methods=("desplt",)).request()


def test_options_out_of_range_are_refused(tmp_path: Path):
    with pytest.raises(ConfigError, match="`--seeds` is 0"):
        Arguments("A5", tmp_path, seeds=0).request()
    with pytest.raises(CaptureError, match="There is no folder '/absent'"):
        Arguments("A5", Path("/absent")).request()


def test_without_methods_those_of_the_table_are_taken(tmp_path: Path):
    request = Arguments("A8", tmp_path).request()
    assert [method.name for method in request.methods] == ["desplat", "desplat-paper", "splatfacto"]
    given = Arguments("A8", tmp_path, methods=("desplat", "lab.reproduce.baselines:by_residual"))
    assert given.request().methods[1].name == "lab.reproduce.baselines.by_residual"
