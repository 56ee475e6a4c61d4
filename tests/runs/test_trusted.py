"""A config.yml is read only if it names nothing but what configures runs."""

from __future__ import annotations

import copy
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from desplat_ns.errors import ConfigError
from desplat_ns.runs.files import find_run
from desplat_ns.runs.trusted import VARIABLE, check_trusted

RUN = """!!python/object:desplat_ns.trainer.DeSplatTrainerConfig
experiment_name: yard
method_name: desplat
timestamp: {}
"""


def config_with(folder: Path, value: str) -> Path:
    """A config.yml of one of our runs with a value in its fourth line, and a checkpoint."""
    (folder / "nerfstudio_models").mkdir(exist_ok=True)
    (folder / "nerfstudio_models" / "step-000000001.ckpt").touch()
    path = folder / "config.yml"
    path.write_text(RUN.format(value))
    return path


@pytest.mark.parametrize(
    "value",
    [
        "!!python/object/apply:os.system ['touch {}']",
        "!<tag:yaml.org,2002:python/object/apply:os.system> ['touch {}']",
        "!!python/object/apply:subprocess.Popen [[touch, '{}']]",
        "!!python/object/new:subprocess.Popen [[touch, '{}']]",
        "!!python/object:subprocess.Popen {{}}",
        "!!python/object/apply:nerfstudio.utils.scripts.run_command ['touch {}']",
        "!!python/object/apply:nerfstudio.utils.scripts.subprocess.Popen [[touch, '{}']]",
        "!!python/object/apply:nerfstudio.utils.eval_utils.os.system ['touch {}']",
        "!!python/object/apply:desplat_ns.process.video.subprocess.run [[touch, '{}']]",
        '!!python/object/apply:builtins.eval [\'open("{}", "w")\']',
        "!!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path ['{}']]",
        "!!python/object/apply:desplat_ns.model.DeSplatModel []",
        "!!python/object/new:pathlib.PosixPath ['{}']",
        "!!python/object:desplat_ns.model.DeSplatModel {{}}",
        "!!python/object:nerfstudio.utils.scripts.run_command {{}}",
        "!!python/name:nerfstudio.utils.scripts.run_command ''",
        "!!python/name:nerfstudio.utils.scripts.subprocess ''",
        "!!python/name:nerfstudio.scripts.eval.ComputePSNR ''",
        "!!python/name:os.system ''",
        "!!python/name:torch.load ''",
        "!!python/name:nerfstudiox.Thing ''",
        "!!python/module:os ''",
        "!custom a",
        "[{{a: [!!python/name:os.system '']}}]",
    ],
)
def test_what_no_run_needs_is_refused_with_its_line_and_nothing_runs(tmp_path: Path, value: str):
    from desplat_ns.runs.loading import load_run

    path = config_with(tmp_path, value.format(tmp_path / "run"))
    with pytest.raises(ConfigError, match=r"config\.yml' ") as raised:
        load_run(find_run(path))
    assert not (tmp_path / "run").exists()
    said = str(raised.value)
    foreign_module = re.search(r"\.(subprocess|os|Path)\.", value)
    if foreign_module is None:  # else there is no module of that name
        tag = value.split("!!")[-1].split(" ")[0] if "!!" in value else value.split(" ")[0]
        assert tag.removeprefix("!<tag:yaml.org,2002:").rstrip(">") in said
        assert "in line 4." in said and VARIABLE in said


def test_the_tag_would_run_if_it_were_not_refused(tmp_path: Path):
    """The file above is dangerous: without the check it is not seen that these tests test."""
    path = config_with(tmp_path, f"!!python/object/apply:os.system ['touch {tmp_path / 'run'}']")
    yaml.load(path.read_text(), Loader=yaml.Loader)
    assert (tmp_path / "run").exists()


@pytest.mark.slow
def test_every_method_and_every_data_parser_is_read(tmp_path: Path):
    """As `ns-train` writes it. Data parsers that other packages bring are nerfstudio's or ours.

    A tag is judged by itself, so that every method once and every data parser once are enough.
    """
    from nerfstudio.configs.dataparser_configs import dataparsers
    from nerfstudio.configs.method_configs import all_methods

    ours = [name for name in all_methods if name.startswith("desplat")]
    parsers = list(dataparsers.values())
    assert len(parsers) > 10 and len(ours) >= 6
    for number in range(max(len(ours), len(parsers))):
        config: Any = copy.deepcopy(all_methods[ours[number % len(ours)]])
        parser = parsers[number % len(parsers)]
        config.pipeline.datamanager.dataparser = copy.deepcopy(parser)
        config.output_dir = tmp_path
        (tmp_path / "config.yml").write_text(yaml.dump(config))
        check_trusted(tmp_path / "config.yml")


def test_a_plugin_is_trusted_once_its_package_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    class Parser:
        pass

    Parser.__module__, Parser.__qualname__ = "my_plugin.parser", "Parser"
    monkeypatch.setitem(sys.modules, "my_plugin", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "my_plugin.parser", SimpleNamespace(Parser=Parser))
    path = config_with(tmp_path, "!!python/name:my_plugin.parser.Parser ''")
    with pytest.raises(ConfigError, match=rf"my_plugin\.parser\.Parser' in line 4.*{VARIABLE}"):
        check_trusted(path)
    monkeypatch.setenv(VARIABLE, "other, my_plugin")
    check_trusted(path)
    monkeypatch.setenv(VARIABLE, "")
    with pytest.raises(ConfigError):
        check_trusted(path)


def test_what_another_version_had_is_told(tmp_path: Path):
    path = config_with(tmp_path, "!!python/object:desplat_ns.gone.Config {}")
    with pytest.raises(ConfigError, match=r"cannot be taken up .*another version"):
        check_trusted(path)
