"""`desplat-tradeoff` as its user meets it: once for real on a tiny capture, and its refusals."""

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


@pytest.mark.slow
def test_a_study_trains_scores_and_reports(tiny_scene: Scene, tmp_path: Path, monkeypatch):
    assert tiny_scene.folder is not None
    plan = Study.plan

    def few(study: Study, most: int) -> list[Run]:
        return [replace(run, steps=4) for run in plan(study, most)[:2]]

    monkeypatch.setattr(Study, "plan", few)
    given = (tiny_scene.folder, PARSER, tmp_path / "out", 3600.0)
    page = tradeoff(*given)
    records = load(tmp_path / "out" / FILE)
    assert [record.options.split()[1] for record in records.values()] == ["4"] * 2
    assert "photos of half their size" in page.read_text()
    for record in records.values():
        assert {"psnr", "mask_iou", "num_masks"} <= set(record.scores)
        assert 0 < record.scores["train_wall_seconds"] < record.seconds
        assert record.scores["backend"] in ("numba", "gsplat")
        assert "torch" in record.scores["versions"]
    assert len(list((tmp_path / "out" / RUNS / "half-size-4-42" / PICTURES).glob("*.png"))) == 2
    assert not list(tmp_path.rglob("nerfstudio_models")), "nobody needs them"
    tradeoff(*given)
    assert load(tmp_path / "out" / FILE) == records, "all of it was done"


def test_a_capture_that_cannot_be_scored_is_refused(tiny_copy: Path, tmp_path: Path):
    for photo in (tiny_copy / "images").glob("*extra*"):
        photo.unlink()
    for data, named in ((tiny_copy, "test split"), (tmp_path / "absent", "absent")):
        with pytest.raises(CaptureError, match=named):
            module.open_study(data, PARSER, tmp_path / "out", 60.0)
