"""`desplat-tradeoff` as its user meets it: once for real on a tiny capture, and its refusals."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.commands.tradeoff import Arguments, default_jobs, recognised_words, study
from desplat_ns.cores import cores
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.studies import plan, runs
from desplat_ns.studies import study as module
from desplat_ns.studies.executors import Keep, LocalExecutor, outcome
from desplat_ns.studies.plan import BASE, TrainingPlan
from desplat_ns.studies.results import RUNS
from desplat_ns.studies.runs import Run
from desplat_ns.studies.study import Request
from desplat_ns.studies.train_and_score import PICTURES, train_and_score
from lab.synthetic import Scene
from tests.helpers.other_process import running, tried

pytestmark = pytest.mark.usefixtures("tyro_may_build")


class InThisProcess:
    """An executor; a process for each run, which `test_runs.py` tests, takes longer to start than
    to train."""

    def do(self, runs: Iterable[Run], folder: Path, keep: Keep) -> list[bool]:
        return [keep(run, outcome(run, folder)) for run in runs]


def train_here(line: list[Any], log: Path, **_: str) -> None:
    """What `runs.run_command` lets another process do."""
    program, results, evaluations, method, *options = map(str, line[2:])
    assert program == runs.PROGRAM
    pictures = Path(results).with_name(PICTURES)
    record = train_and_score(method, options, pictures, int(evaluations))
    Path(results).write_text(json.dumps(record))


@pytest.mark.slow
def test_a_study_trains_scores_and_reports(tiny_scene: Scene, tmp_path: Path, monkeypatch):
    assert tiny_scene.folder is not None
    settled = TrainingPlan(12, (BASE, "appearance-affine"), 12)
    monkeypatch.setattr(module, "plan_for", lambda *_: settled)
    monkeypatch.setattr(plan, "SEEDS", (42,))
    monkeypatch.setattr(plan, "LADDER", (1.0,))
    monkeypatch.setattr(runs, "run_command", train_here)
    request = Request(
        tiny_scene.folder, ("robustnerf-data",), tmp_path / "out", 3600.0, 1, InThisProcess()
    )
    report = study(request)
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["failed"] == {} and results["left_out"] == []
    done = {name.rsplit("-", 2)[0] for name in results["training"]}
    assert done == {*settled.variants, plan.BACKEND}
    assert all(
        [p["step"] for p in row["curve"]] == [3, 6, 12] for row in results["training"].values()
    )
    assert "data:image/jpeg;base64," in report.read_text()
    assert not list((tmp_path / "out" / RUNS).rglob("nerfstudio_models")), "nobody needs them"
    study(replace(request, seconds=3601.0))
    again = json.loads((tmp_path / "out" / "results.json").read_text())
    assert again["training"] == results["training"], "all of it was done"


def test_a_second_study_in_the_same_folder_is_refused(tmp_path: Path, checkout: Path):
    code = "from pathlib import Path; from desplat_ns.files.lock import *\n"
    code += f"with only_process_in(Path({str(tmp_path / 'out')!r})):\n    wait()"
    request = Request(Path("photos"), (), tmp_path / "out", 60.0, 1, LocalExecutor(1))
    with running(code, checkout) as first:
        said = rf"Process {first.pid} is at work in '{tmp_path / 'out'}'"
        with pytest.raises(ConfigError, match=said):
            study(request)


def test_while_a_study_is_done_its_folder_is_taken(
    tmp_path: Path, checkout: Path, monkeypatch: pytest.MonkeyPatch
):
    folder, answers = tmp_path / "out", []

    def opened(_: Request) -> None:
        answers.append(tried(f"only_process_in(Path({str(folder)!r}))", checkout))
        raise CaptureError("far enough")

    monkeypatch.setattr(module, "open_study", opened)
    with pytest.raises(CaptureError, match="far enough"):
        study(Request(Path("photos"), (), folder, 60.0, 1, LocalExecutor(1)))
    assert "is at work in" in answers[0]
    assert list(tmp_path.iterdir()) == [], "and nothing is left"


def test_options_that_cannot_be_are_named(tmp_path: Path):
    with pytest.raises(ConfigError, match="--time is 'soon'"):
        Arguments(Path("photos"), time="soon").request(("colmap",))
    with pytest.raises(ConfigError, match="--jobs` is -1"):
        Arguments(Path("photos"), jobs=-1).request(("colmap",))
    with pytest.raises(CaptureError, match="There is no 'photos'"):
        Arguments(Path("photos")).request(("colmap",))
    assert Arguments(tmp_path).request(("colmap",)).jobs >= 1


def test_a_gpu_has_one_training_at_a_time():
    assert default_jobs("cuda") == 1
    assert default_jobs("cpu") == min(cores(), 8)


def test_layouts_are_found_and_read_as_ns_train_would(tiny_scene: Scene, tmp_path: Path):
    assert tiny_scene.folder is not None
    assert recognised_words(tiny_scene.folder) == ("robustnerf-data",)
    with pytest.raises(CaptureError, match="There is no folder"):
        recognised_words(tmp_path / "absent")
    (tmp_path / "transforms.json").write_text("{}")
    assert recognised_words(tmp_path) == ("nerfstudio-data", "--load-3D-points", "True")


def test_a_capture_that_cannot_be_scored_is_refused(tiny_scene: Scene, tmp_path: Path):
    assert tiny_scene.folder is not None
    folder = tmp_path / "capture"
    shutil.copytree(tiny_scene.folder, folder)
    for photo in (folder / "images").glob("*extra*"):
        photo.unlink()
    options = ("robustnerf-data",)
    request = Request(folder, options, tmp_path / "out", 60.0, 1, LocalExecutor(1))
    with pytest.raises(CaptureError, match=r"extra|held out"):
        module.open_study(request)
    with pytest.raises(CaptureError, match="There is no folder"):
        module.open_study(replace(request, data=tmp_path / "absent"))
