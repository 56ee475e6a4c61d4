"""A run's files: found where they are, mistakes told with the file and what to do."""

from pathlib import Path

import pytest

from desplat_ns.errors import CheckpointError, ConfigError
from desplat_ns.runs.files import find_run

CONFIG = """!!python/object:desplat_ns.trainer.DeSplatTrainerConfig
experiment_name: yard
method_name: desplat
output_dir: !!python/object/apply:pathlib.PosixPath [{parts}]
relative_model_dir: !!python/object/apply:pathlib.PosixPath [nerfstudio_models]
timestamp: run
_target: !!python/name:desplat_ns.trainer.DeSplatTrainer ''
"""


def write_run(folder: Path, output_dir: Path, checkpoint: bool = True) -> Path:
    """A run's folder, as far as it is looked at; its config.yml."""
    folder.mkdir(parents=True)
    parts = ", ".join(repr(part) for part in output_dir.parts)
    (folder / "config.yml").write_text(CONFIG.format(parts=parts))
    (folder / "nerfstudio_models").mkdir()
    if checkpoint:
        (folder / "nerfstudio_models" / "step-000000001.ckpt").touch()
    return folder / "config.yml"


def test_checkpoints_are_where_the_configuration_says(tmp_path: Path):
    folder = tmp_path / "out" / "yard" / "desplat" / "run"
    config = write_run(folder, tmp_path / "out")
    assert find_run(config).checkpoints == (folder / "nerfstudio_models").resolve()
    elsewhere = tmp_path / "copy.yml"
    elsewhere.write_text(config.read_text())
    assert find_run(elsewhere).checkpoints == (folder / "nerfstudio_models").resolve()


def test_a_run_that_was_moved_is_found_beside_its_config(tmp_path: Path):
    config = write_run(tmp_path / "moved", tmp_path / "gone")
    run = find_run(config)
    assert run.checkpoints == (tmp_path / "moved" / "nerfstudio_models").resolve()
    assert run.folder == tmp_path / "moved"
    assert run.events == []


def test_a_run_without_a_checkpoint_is_named(tmp_path: Path):
    config = write_run(tmp_path / "run", tmp_path / "gone", checkpoint=False)
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


def test_what_is_not_there_or_a_folder_is_named(tmp_path: Path):
    for path in (tmp_path / "absent.yml", tmp_path):
        with pytest.raises(ConfigError, match=path.name):
            find_run(path)
