"""A run is trained and scored in a process of its own, which says what its figures are of."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from desplat_ns.errors import DeSplatError
from desplat_ns.studies.grid import execute as module
from desplat_ns.studies.grid.code_version import code_version
from desplat_ns.studies.grid.execute import config_of, execute, log_of, read_results
from desplat_ns.studies.grid.records import Record
from desplat_ns.studies.grid.runs import Run, Scene, Setting, Study
from lab.synthetic import Scene as Written


class Ready:
    """A capture that is there."""

    def __init__(self, folder: Path | None):
        self.folder = folder

    def locate(self, folder: Path) -> Path:
        assert self.folder is not None
        return self.folder

    def describe(self) -> dict[str, str]:
        return {"folder": "ready"}


WHERE = {"device": "cuda", "backend": "gsplat"}


class NotThere(Ready):
    """A capture that cannot be found."""

    def __init__(self):
        super().__init__(None)

    def locate(self, folder: Path) -> Path:
        raise DeSplatError("not there")


def study_of(folder: Path | None, figures: tuple[str, ...] = ("psnr", "mask_iou")) -> Study:
    settings = {"ours": Setting("desplat", ("--pipeline.model.num-downscales", "0"))}
    return Study(settings, {"tiny": Scene(Ready(folder), ("robustnerf-data",))}, (), figures)


RUN = Run("ours", "tiny", 1, 3, 42)


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_a_run_gives_figures_commit_and_the_settings_of_today(tiny_scene: Written, tmp_path: Path):
    study = study_of(tiny_scene.folder, ("psnr", "mask_iou", "train_cpu_seconds", "num_masks"))
    found = execute(study, RUN, tmp_path)
    assert set(found.figures) == set(study.figures)
    assert found.figures["train_cpu_seconds"] > 0 and found.figures["num_masks"] == 6
    assert found.device in ("cpu", "cuda") and found.backend in ("numba", "gsplat")
    assert found.commit == code_version()
    assert found.settings == study.settings_of(RUN)
    config = config_of(study, RUN, tmp_path)
    assert yaml.load(config.read_text(), Loader=yaml.Loader).get_base_dir() == config.parent
    assert len(list((tmp_path / RUN.name / "pictures").glob("*.png"))) == 2


def test_the_process_has_one_thread_and_sleeps_while_it_waits(monkeypatch, tmp_path: Path):
    for name in ("OMP_WAIT_POLICY", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    probe = tmp_path / "probe.py"
    probe.write_text(
        "import json, os, sys\n"
        "figures = {'OMP_WAIT_POLICY': os.environ.get('OMP_WAIT_POLICY') == 'passive'}\n"
        "for name in ('OMP_NUM_THREADS', 'NUMBA_NUM_THREADS'):\n"
        "    figures[name] = int(os.environ.get(name, 0))\n"
        "rest = {'curve': [], 'commit': 'x', 'settings': {}, 'device': 'cpu', 'backend': None}\n"
        "json.dump({'figures': figures, **rest}, open(sys.argv[1], 'w'))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)  # what this process can import, the other can
    monkeypatch.setattr(module, "PROGRAM", "probe")
    figures = ("OMP_WAIT_POLICY", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
    found = execute(study_of(tmp_path, figures), RUN, tmp_path / "runs")
    assert tuple(found.figures.values()) == (True, 1, 1)


def test_a_run_that_fails_names_its_log(monkeypatch, tmp_path: Path):
    monkeypatch.setattr(module, "PROGRAM", "no_such_module")
    with pytest.raises(DeSplatError, match=r"Its log: .*run\.log"):
        execute(study_of(tmp_path), RUN, tmp_path / "runs")


def test_an_earlier_run_stays_until_another_is_whole(monkeypatch, tmp_path: Path):
    earlier = tmp_path / RUN.name / "run.log"
    earlier.parent.mkdir()
    earlier.touch()
    missing = Study(study_of(None).settings, {"tiny": Scene(NotThere(), ())}, (), ("psnr",))
    with pytest.raises(DeSplatError, match="not there"):
        execute(missing, RUN, tmp_path)
    assert earlier.exists()
    monkeypatch.setattr(module, "PROGRAM", "no_such_module")
    with pytest.raises(DeSplatError):
        execute(study_of(tmp_path), RUN, tmp_path)
    assert earlier.exists() and log_of(RUN, tmp_path).is_file()
    probe = tmp_path / "whole.py"
    results = {"figures": {"psnr": 1.0}, "curve": [], "commit": "c", "settings": {}, **WHERE}
    probe.write_text(f"import sys; open(sys.argv[1], 'w').write({json.dumps(results)!r})")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(module, "PROGRAM", "whole")
    execute(study_of(tmp_path), RUN, tmp_path)
    assert sorted(path.name for path in earlier.parent.iterdir()) == ["results.json", "run.log"]
    assert not log_of(RUN, tmp_path).parent.exists()


def test_only_the_studys_figures_are_kept(tmp_path: Path):
    results = {"figures": {"psnr": 1.0, "ssim": 2.0}, "commit": "c", "settings": {"a": 1}}
    results |= WHERE | {"curve": [{"step": 5, "psnr": 0.5, "ssim": 1.0}]}
    (tmp_path / "results.json").write_text(json.dumps(results))
    plain, settings = study_of(None), {"a": 1, "scene.folder": "ready"}
    assert read_results(plain, RUN, tmp_path / "results.json") == Record(
        {"psnr": 1.0}, "c", settings, **WHERE, curve=({"step": 5, "psnr": 0.5},)
    )
