from __future__ import annotations

from pathlib import Path

import pytest

from desplat_ns.errors import DeSplatError
from lab.gpu.parts import synchronisations, training
from lab.gpu.plan import Job


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_the_generated_scene_is_trained_scored_and_shared(tmp_path: Path):
    job = Job("cpu", True, str(tmp_path), case="cpu")
    (record,) = training.measure(job)
    assert (record["device"], record["backend"], record["steps"]) == ("cpu", "numba", 20)
    assert record["psnr"] > 5 and 0 <= record["mask_iou"] <= 1 and record["train_wall_seconds"] > 0
    photos = tmp_path / "scene" / "images"
    before = [path.stat().st_mtime_ns for path in sorted(photos.iterdir())]
    assert training.capture(job) == tmp_path / "scene"
    assert [path.stat().st_mtime_ns for path in sorted(photos.iterdir())] == before
    assert not list(tmp_path.glob("scene-*"))
    assert (tmp_path / "training.cpu" / training.PICTURE).stat().st_size > 0


def test_without_the_real_capture_it_says_where_to_look(monkeypatch):
    monkeypatch.setenv("DESPLAT_NS_DATA", "/nowhere")
    with pytest.raises(DeSplatError, match="no fox_cluttered: set DESPLAT_NS_DATA"):
        training.real_capture()


@pytest.mark.real_data
def test_the_real_capture_is_read_at_half_its_size(data_folder):
    folder = data_folder("fox_cluttered")
    assert training.real_capture() == ["--data", str(folder), "--downscale-factor", "2"]


def test_the_picture_that_is_kept_is_of_the_worst_view(tmp_path: Path):
    (tmp_path / "pictures").mkdir()
    for index in range(3):
        (tmp_path / "pictures" / f"eval_img_{index:04d}.png").write_text(str(index))
    training.keep_the_worst([{"psnr": 30.0}, {"psnr": 20.0}, {"psnr": 25.0}], tmp_path)
    assert (tmp_path / training.PICTURE).read_text() == "1"


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_both_methods_are_profiled_as_registered(tmp_path: Path):
    *_, figures = synchronisations.measure(Job("cpu", True, str(tmp_path)))
    assert list(figures["methods"]) == ["splatfacto", "desplat"]
    for counts in figures["methods"].values():
        assert counts["aten::_local_scalar_dense"] > 0
        assert counts["waits"] == counts["launches"] == 0  # there is no device to wait for
