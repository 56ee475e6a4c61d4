"""A run's files: found where they are, mistakes told with the file and what to do."""

import os
from pathlib import Path

import pytest

from desplat_ns.core.errors import CheckpointError, ConfigError
from desplat_ns.core.run_files import find_run, found, newest_run

CONFIG = """!!python/object:desplat_ns.training.trainer.DeSplatTrainerConfig
experiment_name: yard
"""


def write_run(folder: Path, checkpoint: bool = True) -> Path:
    """A run's folder, as far as it is looked at; its config.yml."""
    (folder / "models").mkdir(parents=True)
    (folder / "config.yml").write_text(CONFIG)
    if checkpoint:
        (folder / "models" / "step-000000001.ckpt").touch()
    return folder / "config.yml"


def test_checkpoints_are_found_beside_config_yml_and_what_is_being_saved_is_none(tmp_path: Path):
    config = write_run(tmp_path / "moved")
    (tmp_path / "moved" / ".saving").mkdir()
    (tmp_path / "moved" / ".saving" / "step-000000009.ckpt").touch()
    run = find_run(config)
    assert run.checkpoints == (tmp_path / "moved" / "models").resolve()
    assert run.folder == tmp_path / "moved"


def test_what_config_yml_names_is_found_where_all_was_moved_together(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "captures" / "yard").mkdir(parents=True)
    assert found(Path("/old/captures/yard")) == Path("captures/yard")
    assert found(tmp_path / "captures") == tmp_path / "captures"
    assert found(Path("/old/other")) == Path("/old/other")


def test_a_run_without_a_checkpoint_is_named(tmp_path: Path):
    config = write_run(tmp_path / "run", checkpoint=False)
    with pytest.raises(CheckpointError, match="--steps-per-save"):
        find_run(config)


@pytest.mark.parametrize(
    "content",
    [
        b"a: [",
        b"",
        b"just words",
        b"method_name: desplat",
        b"!!python/object:nerfstudio.engine.trainer.TrainerConfig\na: 1",
        b"\xff\xfe\x00",
    ],
)
def test_what_is_no_run_of_ours_is_named(tmp_path: Path, content: bytes):
    (tmp_path / "other.yml").write_bytes(content)
    with pytest.raises(ConfigError, match="other"):
        find_run(tmp_path / "other.yml")


def test_what_is_not_there_a_folder_or_a_pipe_is_named(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.yml")
    for path in (tmp_path / "absent.yml", tmp_path / "pipe.yml", tmp_path):
        with pytest.raises(ConfigError, match=path.name):
            find_run(path)


def test_a_folder_stands_for_the_run_that_was_saved_last(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, second = (write_run(Path("outputs/yard") / run) for run in ("desplat/a", "quick/b"))
    unsaved = write_run(Path("outputs/yard/desplat/c"), checkpoint=False)
    os.utime(second.parent / "models/step-000000001.ckpt", (2e9, 2e9))
    for path in ("outputs", "outputs/yard", "captures/yard", "outputs/yard/quick/b"):
        assert newest_run(Path(path)) == second
    assert newest_run(Path("outputs/yard/desplat")) == newest_run(first) == first
    assert newest_run(unsaved.parent) == unsaved.parent
    assert newest_run(Path("elsewhere")) == Path("elsewhere")
