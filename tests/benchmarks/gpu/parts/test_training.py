from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.gpu.parts import synchronisations, training
from benchmarks.gpu.plan import Job


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_the_generated_scene_is_trained_scored_and_shared(tmp_path: Path):
    job = Job("cpu", True, str(tmp_path), case="cpu")
    (found,) = training.measure(job)
    assert (found["device"], found["backend"], found["steps"]) == ("cpu", "numba", 20)
    assert found["psnr"] > 5 and 0 <= found["mask_iou"] <= 1 and found["train_wall_seconds"] > 0
    photos = tmp_path / "scene" / "images"
    before = [path.stat().st_mtime_ns for path in sorted(photos.iterdir())]
    assert training.capture(job) == tmp_path / "scene"
    assert [path.stat().st_mtime_ns for path in sorted(photos.iterdir())] == before
    assert not list(tmp_path.glob("scene-*"))


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_both_methods_are_profiled_as_registered(tmp_path: Path):
    *_, found = synchronisations.measure(Job("cpu", True, str(tmp_path)))
    assert list(found["methods"]) == ["splatfacto", "desplat"]
    for counts in found["methods"].values():
        assert counts["aten::_local_scalar_dense"] > 0
        assert counts["waits"] == counts["launches"] == 0  # there is no device to wait for
