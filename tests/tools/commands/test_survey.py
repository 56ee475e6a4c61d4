"""`desplat-survey`: the findings are written, by the data parser that is asked for."""

import json
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.core.errors import ConfigError
from desplat_ns.tools.commands import split_words
from desplat_ns.tools.commands.survey import Arguments


def found(folder: Path) -> dict[str, Any]:
    """The findings that were written."""
    return json.loads((folder / "survey.json").read_text())


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_a_data_parser_and_its_options_choose_the_photos(tiny_scene, tmp_path: Path):
    clean = ("robustnerf-data", "--train-split-clean-clutter-ratio", "0")
    words = [str(tiny_scene.folder), "--output", str(tmp_path / "clean"), *clean]
    arguments, parser = split_words(Arguments, "desplat-survey", words)
    arguments.main(parser)
    assert found(tmp_path / "clean")["num_photos"] == tiny_scene.spec.num_views
    Arguments(tiny_scene.folder, tmp_path / "all").main(("colmap",))
    assert found(tmp_path / "all")["num_photos"] > tiny_scene.spec.num_views


@pytest.mark.slow
def test_findings_are_written_and_replaced_only_if_that_is_asked_for(
    tiny_scene, tmp_path: Path, capsys
):
    file, arguments = tmp_path / "survey.json", Arguments(tiny_scene.folder, tmp_path)
    file.write_text("before")
    with pytest.raises(ConfigError, match=r"survey\.json"):
        arguments.main()
    assert file.read_text() == "before"
    arguments.overwrite = True
    arguments.main()
    assert "robustnerf-data" in capsys.readouterr().out
    assert found(tmp_path)["appearance"]["decision"] == "off"
