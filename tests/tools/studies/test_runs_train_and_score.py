"""Only what was trained to its last step is scored."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from desplat_ns.tools.studies import runs as module
from desplat_ns.tools.studies.runs import QUIET, train_and_score
from desplat_ns.training.datamanager import DeSplatDataManager
from desplat_ns.training.trainer import DeSplatTrainer
from lab.synthetic import Scene

pytestmark = pytest.mark.usefixtures("tyro_may_build")


def options_for(scene: Scene, folder: Path) -> list[str]:
    places = ["--data", str(scene.folder), "--output-dir", str(folder), *QUIET]
    short = ["--max-num-iterations", "3", "--pipeline.model.num-downscales", "0"]
    return [*places, *short, "robustnerf-data"]


def test_a_run_that_is_stopped_has_no_figures(tiny_scene: Scene, tmp_path: Path, monkeypatch):
    train = DeSplatTrainer.train_iteration

    def stop_after(self: DeSplatTrainer, step: int):
        self._stop_after_this_step("SIGINT")
        return train(self, step)

    monkeypatch.setattr(DeSplatTrainer, "train_iteration", stop_after)
    with pytest.raises(SystemExit, match="1 of 3 steps"):
        train_and_score("desplat", options_for(tiny_scene, tmp_path), tmp_path / "pictures")
    assert not (tmp_path / "pictures").exists()


def test_reading_photos_and_the_last_checkpoint_are_no_training(
    tiny_scene: Scene, tmp_path: Path, monkeypatch
):
    """Both take an hour of a clock that is set forward meanwhile."""
    forward = [0.0]

    def slow(cls: type, name: str) -> None:
        usual = getattr(cls, name)

        def slowly(*arguments: Any, **more: Any) -> Any:
            forward[0] += 3600
            return usual(*arguments, **more)

        monkeypatch.setattr(cls, name, slowly)

    slow(DeSplatDataManager, "_load_images")
    slow(DeSplatTrainer, "save_checkpoint")
    clock = SimpleNamespace(
        perf_counter=lambda: time.perf_counter() + forward[0], process_time=time.process_time
    )
    monkeypatch.setattr(module, "time", clock)
    figures, _ = train_and_score(
        "desplat", options_for(tiny_scene, tmp_path), tmp_path / "pictures"
    )
    assert forward[0] >= 2 * 3600
    assert 0 < figures["train_wall_seconds"] < 3600
