"""A config.yml is read only if it names nothing but what configures runs."""

import copy
import importlib
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from nerfstudio.configs.dataparser_configs import all_dataparsers
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.scripts import train
from nerfstudio.utils import eval_utils

from desplat_ns.core.errors import ConfigError
from desplat_ns.core.run_files import find_run
from desplat_ns.data.layouts import OURS, without_prompts
from desplat_ns.plugin import UNPICKLES, trusted_tags
from desplat_ns.tools.loading import load_run
from desplat_ns.training.run_config import RunConfig

PLUGIN = """
from dataclasses import dataclass
from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig

@dataclass
class Config(DataParserConfig):
    pass
"""

RUN = """!!python/object:desplat_ns.training.trainer.DeSplatTrainerConfig
experiment_name: yard
method_name: desplat
timestamp: {}
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The data parser of a plugin that is installed and not registered."""
    (tmp_path / "my_plugin.py").write_text(PLUGIN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_plugin", raising=False)
    return importlib.import_module("my_plugin").Config()


def config_with(folder: Path, value: str) -> Path:
    """A config.yml of one of our runs with a value in its fourth line, and a checkpoint."""
    (folder / "nerfstudio_models").mkdir(exist_ok=True)
    (folder / "nerfstudio_models" / "step-000000001.ckpt").touch()
    path = folder / "config.yml"
    path.write_text(RUN.format(value))
    return path


def read(path: Path) -> Any:
    """As nerfstudio does."""
    return yaml.load(path.read_text(), Loader=yaml.Loader)


@pytest.mark.parametrize(
    "value",
    [
        "!!python/object/apply:os.system ['touch {}']",
        "!<tag:yaml.org,2002:python/object/apply:os.system> ['touch {}']",
        "!!python/object/new:subprocess.Popen [[touch, '{}']]",
        "!!python/object/apply:nerfstudio.utils.scripts.subprocess.Popen [[touch, '{}']]",
        '!!python/object/apply:builtins.eval [\'open("{}", "w")\']',
        "!!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path ['{}']]",
        "!!python/object:desplat_ns.model.DeSplatModel {{}}",
        "!!python/name:nerfstudio.utils.scripts.run_command ''",
        "!!python/name:os.system ''",
        "!!python/module:os ''",
        "[{{a: [!!python/name:os.system '']}}]",
    ],
)
def test_what_no_run_needs_is_refused_with_its_line_and_nothing_runs(tmp_path: Path, value: str):
    path = config_with(tmp_path, value.format(tmp_path / "run"))
    with pytest.raises(ConfigError, match=r"config\.yml") as raised:
        load_run(find_run(path))
    assert not (tmp_path / "run").exists()
    tag = value.split("!!")[-1].split(" ")[0] if "!!" in value else value.split(" ")[0]
    assert tag.removeprefix("!<tag:yaml.org,2002:").rstrip(">") in str(raised.value)
    assert "in line 4" in str(raised.value)


@pytest.mark.parametrize("command", ["eval_setup", "ns-train --load-config"])
def test_nerfstudios_commands_refuse_it_in_runs_of_ours(tmp_path: Path, command: str):
    path = tmp_path / "config.yml"
    path.write_text(RUN.format(f"!!python/object/apply:os.system ['touch {tmp_path / 'run'}']"))
    with pytest.raises(ConfigError, match=r"os\.system.*line 4"):
        if command == "eval_setup":
            eval_utils.eval_setup(path)
        else:
            train.main(replace(all_methods["desplat"], load_config=path))
    assert not (tmp_path / "run").exists()


def test_runs_of_other_methods_are_read_as_before_and_after_a_run_of_ours(tmp_path: Path, plugin):
    """Also with the data parser of a plugin that registers no method."""
    with pytest.raises(ConfigError):
        read(config_with(tmp_path, "!!python/name:os.system ''"))
    for method in ("nerfacto", "splatfacto"):
        config = copy.deepcopy(all_methods[method])
        config.pipeline.datamanager.dataparser = plugin
        assert yaml.load(yaml.dump(config), Loader=yaml.Loader) == config


def test_a_data_parser_that_reads_pickles_is_no_runs_of_ours(tmp_path: Path):
    parser = yaml.dump([all_dataparsers[UNPICKLES]], default_flow_style=True, width=10**6)
    with pytest.raises(ConfigError, match="Minimal"):
        read(config_with(tmp_path, parser))


@pytest.mark.slow
def test_every_method_and_every_data_parser_is_read(tmp_path: Path):
    """As `ns-train` writes it: with the data parser that it was given, and with the one that our
    data manager takes instead."""
    ours = [name for name in all_methods if name.startswith("desplat")]
    parsers = [p for name, p in {**OURS, **all_dataparsers}.items() if name != UNPICKLES]
    settled = [without_prompts(all_dataparsers[name]) for name in ("colmap", "nerfstudio-data")]
    assert len(parsers) > 10 and len(ours) >= 6
    for number, parser in enumerate([*parsers, *settled]):
        config: Any = copy.deepcopy(all_methods[ours[number % len(ours)]])
        config.pipeline.datamanager.dataparser = copy.deepcopy(parser)
        config.output_dir = tmp_path
        (tmp_path / "config.yml").write_text(yaml.dump(config))
        assert read(tmp_path / "config.yml") == config


def test_a_plugin_is_trusted_once_it_is_registered(tmp_path: Path, monkeypatch, plugin):
    path = config_with(tmp_path, yaml.dump([plugin], default_flow_style=True, width=10**6))
    with pytest.raises(ConfigError, match="my_plugin"):
        read(path)
    monkeypatch.setitem(all_dataparsers, "mine", plugin)
    trusted_tags.cache_clear()
    assert read(path).timestamp == [plugin]
    monkeypatch.undo()
    trusted_tags.cache_clear()


def test_a_mistake_of_a_program_is_not_taken_for_a_run_of_another_version(
    tmp_path: Path, monkeypatch
):
    def of_config_yml(config: Any) -> Any:
        return config.gone

    def of_the_program(config: Any) -> Any:
        return config.load_step.gone

    files = find_run(config_with(tmp_path, "now"))
    monkeypatch.setattr(RunConfig, "get_checkpoint_dir", of_config_yml)
    with pytest.raises(ConfigError, match="another version"):
        load_run(files)
    monkeypatch.setattr(RunConfig, "get_checkpoint_dir", of_the_program)
    with pytest.raises(AttributeError, match="NoneType"):
        load_run(files)
