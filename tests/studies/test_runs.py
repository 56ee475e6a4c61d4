"""A run is trained and scored in a process of its own, which says what its figures are of."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from desplat_ns.errors import DeSplatError
from desplat_ns.studies import runs as module
from desplat_ns.studies.machine import code_version
from desplat_ns.studies.runs import Record, Run, Variant, execute, log_of
from lab.synthetic import Scene as Written

WHERE = {"device": "cuda", "backend": "gsplat"}
OURS = Variant("ours", options=("--pipeline.model.num-downscales", "0"))


def run_on(folder: Path | None) -> Run:
    return Run(OURS, 3, 42, folder or Path("/absent"), ("robustnerf-data",))


NAME = run_on(None).name


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_a_run_gives_figures_and_says_of_which_code_and_on_what(
    tiny_scene: Written, tmp_path: Path
):
    record = execute(run_on(tiny_scene.folder), tmp_path)
    assert {"psnr", "mask_iou", "num_masks"} <= set(record.figures)
    assert record.figures["num_masks"] == 6
    assert 0 < record.figures["train_wall_seconds"] < record.figures["run_wall_seconds"]
    assert record.device in ("cpu", "cuda") and record.backend in ("numba", "gsplat")
    assert record.commit == code_version()
    (config,) = (tmp_path / NAME).glob("x/desplat/run/config.yml")
    assert yaml.load(config.read_text(), Loader=yaml.Loader).get_base_dir() == config.parent
    assert len(list((tmp_path / NAME / "pictures").glob("*.png"))) == 2


def test_the_process_has_one_thread_and_sleeps_while_it_waits(monkeypatch, tmp_path: Path):
    for name in ("OMP_WAIT_POLICY", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    probe = tmp_path / "probe.py"
    probe.write_text(
        "import json, os, sys\n"
        "figures = {'OMP_WAIT_POLICY': os.environ.get('OMP_WAIT_POLICY') == 'passive'}\n"
        "for name in ('OMP_NUM_THREADS', 'NUMBA_NUM_THREADS'):\n"
        "    figures[name] = int(os.environ.get(name, 0))\n"
        "rest = {'curve': [], 'commit': 'x', 'device': 'cpu', 'backend': None}\n"
        "json.dump({'figures': figures, **rest}, open(sys.argv[1], 'w'))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)  # what this process can import, the other can
    monkeypatch.setattr(module, "PROGRAM", "probe")
    record = execute(run_on(tmp_path), tmp_path / "runs")
    names = ("OMP_WAIT_POLICY", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
    assert [record.figures[name] for name in names] == [True, 1, 1]


def test_a_run_that_fails_names_its_log(monkeypatch, tmp_path: Path):
    monkeypatch.setattr(module, "PROGRAM", "no_such_module")
    with pytest.raises(DeSplatError, match=r"Its log: .*run\.log"):
        execute(run_on(tmp_path), tmp_path / "runs")


def test_an_earlier_run_stays_until_another_is_whole(monkeypatch, tmp_path: Path):
    earlier = tmp_path / NAME / "run.log"
    earlier.parent.mkdir()
    earlier.touch()
    with pytest.raises(DeSplatError, match="There is no capture at /absent"):
        execute(run_on(None), tmp_path)
    assert earlier.exists()
    monkeypatch.setattr(module, "PROGRAM", "no_such_module")
    with pytest.raises(DeSplatError):
        execute(run_on(tmp_path), tmp_path)
    assert earlier.exists() and log_of(NAME, tmp_path).is_file()
    probe = tmp_path / "whole.py"
    results = {"figures": {"psnr": 1.0}, "curve": [], "commit": "c", **WHERE}
    probe.write_text(f"import sys; open(sys.argv[1], 'w').write({json.dumps(results)!r})")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(module, "PROGRAM", "whole")
    execute(run_on(tmp_path), tmp_path)
    assert sorted(path.name for path in earlier.parent.iterdir()) == ["results.json", "run.log"]
    assert not log_of(NAME, tmp_path).parent.exists()


def test_numbers_are_kept_and_nothing_else(monkeypatch, tmp_path: Path):
    results = {"figures": {"psnr": 1.0, "images": [], "backend": "gsplat"}, "commit": "c", **WHERE}
    results["curve"] = [{"step": 5, "psnr": 0.5, "images": []}]
    (tmp_path / "kept.py").write_text(
        f"import sys; open(sys.argv[1], 'w').write({json.dumps(results)!r})"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(module, "PROGRAM", "kept")
    record = execute(run_on(tmp_path), tmp_path / "runs")
    seconds = record.figures["run_wall_seconds"]
    figures = {"psnr": 1.0, "run_wall_seconds": seconds}
    assert record == Record(figures, "c", **WHERE, curve=({"step": 5, "psnr": 0.5},))
