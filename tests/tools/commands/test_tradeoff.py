"""`desplat-tradeoff` as its user meets it: once for real on a tiny capture, and its refusals."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.tools.studies import tradeoff as module
from desplat_ns.tools.studies.records import FILE, RUNS, load
from desplat_ns.tools.studies.runs import PICTURES, Run
from desplat_ns.tools.studies.tradeoff import Study, tradeoff
from lab.synthetic import Scene

pytestmark = pytest.mark.usefixtures("tyro_may_build")

PARSER = ("robustnerf-data",)
PLAN = Study.plan


@pytest.mark.slow
def test_a_study_trains_scores_and_reports(tiny_scene: Scene, tmp_path: Path, monkeypatch):
    assert tiny_scene.folder is not None

    def few(study: Study, most: int) -> list[Run]:
        runs = PLAN(study, most)
        return [replace(run, steps=4) for run in runs[:3]]

    monkeypatch.setattr(Study, "plan", few)
    given = (tiny_scene.folder, PARSER, tmp_path / "out", 3600.0)
    page = tradeoff(*given)
    records = load(tmp_path / "out" / FILE)
    assert [record.options.split()[1] for record in records.values()] == ["4"] * 3
    assert "photos of half their size" in page.read_text()
    assert (tmp_path / "out" / RUNS / "fewer-4-42" / PICTURES).is_dir()
    tradeoff(*given)
    assert load(tmp_path / "out" / FILE) == records, "all of it was done"


def test_a_capture_that_cannot_be_scored_is_refused(tiny_scene: Scene, tmp_path: Path):
    assert tiny_scene.folder is not None
    folder = tmp_path / "capture"
    shutil.copytree(tiny_scene.folder, folder)
    for photo in (folder / "images").glob("*extra*"):
        photo.unlink()
    for data, named in ((folder, "test split"), (tmp_path / "absent", "absent")):
        with pytest.raises(CaptureError, match=named):
            module.open_study(data, PARSER, tmp_path / "out", 60.0)
