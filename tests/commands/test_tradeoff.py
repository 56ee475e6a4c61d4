"""`desplat-tradeoff` as its user meets it: once for real on a tiny capture, and its refusals."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from desplat_ns.commands.tradeoff import Arguments, default_jobs, recognised_words, study
from desplat_ns.cores import cores
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.studies import plan
from desplat_ns.studies import study as module
from desplat_ns.studies.executors import RUNS, Executor
from desplat_ns.studies.records import FILE, load
from desplat_ns.studies.runs import PICTURES
from desplat_ns.studies.study import Request
from lab.reproduce.smoke import here
from lab.synthetic import Scene
from tests.helpers.other_process import running, tried

pytestmark = pytest.mark.usefixtures("tyro_may_build")


def request_of(data: Path, output: Path, **given) -> Request:
    return replace(Request(data, ("robustnerf-data",), output, 60.0, Executor(do=here)), **given)


@pytest.mark.slow
def test_a_study_trains_scores_and_reports(tiny_scene: Scene, tmp_path: Path, monkeypatch):
    assert tiny_scene.folder is not None
    monkeypatch.setattr(plan, "SHORTEST", 3)
    monkeypatch.setattr(plan, "SEEDS", (42,))
    monkeypatch.setattr(plan, "LADDER", (1.0,))
    monkeypatch.setattr(module, "steps_that_fit", lambda *_: 4)
    request = request_of(tiny_scene.folder, tmp_path / "out", seconds=3600.0)
    report = study(request)
    records = load(tmp_path / "out" / FILE)
    lengths = [record.options.split()[1] for record in records.values()]
    assert sorted(lengths) == ["3", *["4"] * 8]
    assert "photos of half their size" in report.read_text()
    assert (tmp_path / "out" / RUNS / "fewer-4-42" / PICTURES).is_dir()
    study(request)
    assert load(tmp_path / "out" / FILE) == records, "all of it was done"


def test_a_second_study_in_the_same_folder_is_refused(tmp_path: Path, checkout: Path):
    code = "from pathlib import Path; from desplat_ns.files.lock import *\n"
    code += f"with only_process_in(Path({str(tmp_path / 'out')!r})):\n    wait()"
    with running(code, checkout) as first, pytest.raises(ConfigError, match=str(first.pid)):
        study(request_of(Path("photos"), tmp_path / "out"))


def test_while_a_study_is_done_its_folder_is_taken(
    tmp_path: Path, checkout: Path, monkeypatch: pytest.MonkeyPatch
):
    folder, answers = tmp_path / "out", []

    def opened(_: Request) -> None:
        answers.append(tried(f"only_process_in(Path({str(folder)!r}))", checkout))
        raise CaptureError("far enough")

    monkeypatch.setattr(module, "open_study", opened)
    with pytest.raises(CaptureError, match="far enough"):
        study(request_of(Path("photos"), folder))
    assert "is at work in" in answers[0]
    assert list(tmp_path.iterdir()) == [], "and nothing is left"


def test_options_that_cannot_be_are_named(tmp_path: Path):
    with pytest.raises(ConfigError, match="--time"):
        Arguments(Path("photos"), time="soon").request(("colmap",))
    with pytest.raises(ConfigError, match="--jobs"):
        Arguments(Path("photos"), jobs=-1).request(("colmap",))
    with pytest.raises(CaptureError, match="'photos'"):
        Arguments(Path("photos")).request(("colmap",))
    assert Arguments(tmp_path).request(("colmap",)).executor.jobs >= 1


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
    request = request_of(folder, tmp_path / "out")
    with pytest.raises(CaptureError, match="test split"):
        module.open_study(request)
    with pytest.raises(CaptureError, match="absent"):
        module.open_study(replace(request, data=tmp_path / "absent"))
