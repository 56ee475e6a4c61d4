"""Runs on Ray are those of this machine; a killed worker costs time and nothing else."""

from __future__ import annotations

import os
import signal
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from desplat_ns.errors import DeSplatError
from desplat_ns.studies import executors
from desplat_ns.studies.executors import (
    Executor,
    LocalExecutor,
    RayExecutor,
    executor_of,
    import_ray,
)
from desplat_ns.studies.runs import Record, Run, Variant
from lab.synthetic import Scene

GIVEN = ("--pipeline.model.effects.auto", "False")
PLAIN = Variant("plain", options=GIVEN)


@dataclass(frozen=True)
class KillsOnce(Run):
    """The first process that asks for its options is killed on the spot, unless it is the study's
    own."""

    marker: Path = Path()
    study: int = 0

    @property
    def options(self) -> tuple[str, ...]:
        if os.getpid() != self.study and not self.marker.exists():
            self.marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().options


RUNS = [Run(PLAIN, 12, seed, Path("/absent"), ("colmap",)) for seed in (42, 43)]


def outcomes(executor: Executor, runs: list[Run], folder: Path) -> dict[int, Record | Exception]:
    """What becomes of each run, by its seed."""
    by_seed: dict[int, Record | Exception] = {}

    def keep(run: Run, outcome: Record | Exception) -> bool:
        by_seed[run.seed] = outcome
        return isinstance(outcome, Record)

    folder.mkdir()
    done = executor.do(runs, folder, keep)
    assert sorted(done) == sorted(isinstance(outcome, Record) for outcome in by_seed.values())
    return by_seed


def test_ray_gives_what_this_machine_gives_and_begins_anew_when_a_worker_is_killed(
    tiny_scene: Scene, tmp_path: Path
):
    pytest.importorskip("ray", reason="Ray is not installed (pip install 'desplat-ns[ray]')")
    assert tiny_scene.folder is not None
    tiny, absent = Run(PLAIN, 12, 42, tiny_scene.folder, ("robustnerf-data",)), RUNS[1]
    here = outcomes(LocalExecutor(2), [tiny, absent], tmp_path / "here")
    marker = tmp_path / "killed"
    deadly = KillsOnce(**vars(tiny), marker=marker, study=os.getpid())
    there = outcomes(RayExecutor(jobs=2), [deadly, absent], tmp_path / "there")
    assert marker.exists()
    mine, other = here[42], there[42]
    assert isinstance(mine, Record) and isinstance(other, Record), (mine, other)
    same = {name for name in mine.figures if "seconds" not in name}
    assert {n: mine.figures[n] for n in same} == {n: other.figures[n] for n in same}
    for by_seed, where in ((here, ""), (there, "On the Ray worker ")):
        assert str(by_seed[43]).startswith(where)
        assert "There is no capture at /absent" in str(by_seed[43])


def test_a_study_without_ray_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(DeSplatError, match=r"pip install 'desplat-ns\[ray\]'"):
        RayExecutor().do(RUNS, tmp_path, lambda *_: True)
    with pytest.raises(DeSplatError, match="not installed"):
        import_ray()


def test_an_address_at_which_no_cluster_answers_is_named(monkeypatch, tmp_path):
    pytest.importorskip("ray", reason="Ray is not installed (pip install 'desplat-ns[ray]')")
    with pytest.raises(DeSplatError, match=r"--ray-address 127\.0\.0\.1:1 "):
        RayExecutor("127.0.0.1:1").do(RUNS[:1], tmp_path, lambda *_: True)


def test_the_next_run_is_asked_for_when_there_is_a_place_for_it(monkeypatch, tmp_path):
    """So that who gives the runs may go by the clock."""
    events = []
    runs = [replace(RUNS[0], seed=seed) for seed in range(3)]

    def coming():
        for run in runs:
            events.append(("asked", run.seed))
            yield run

    def keep(run: Run, outcome: Record | Exception) -> bool:
        events.append(("done", run.seed))
        return run.seed != 1

    monkeypatch.setattr(executors, "outcome", lambda run, folder: DeSplatError("no"))
    assert LocalExecutor(1).do(coming(), tmp_path, keep) == [True, False, True]
    assert events == [(what, seed) for seed in range(3) for what in ("asked", "done")]


def test_no_further_run_begins_once_a_record_cannot_be_kept(monkeypatch, tmp_path):
    asked = []

    def coming():
        for seed in range(100):
            asked.append(seed)
            yield replace(RUNS[0], seed=seed)

    def keep(run: Run, outcome: Record | Exception) -> bool:
        raise DeSplatError("the disk is full")

    monkeypatch.setattr(executors, "outcome", lambda run, folder: DeSplatError("no"))
    with pytest.raises(DeSplatError, match="the disk is full"):
        LocalExecutor(2).do(coming(), tmp_path, keep)
    assert len(asked) <= 2


def test_executors_have_names():
    assert executor_of("local", 3, None) == LocalExecutor(3)
    assert executor_of("ray", 2, "here:1") == RayExecutor("here:1", 2)
