from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from filelock import FileLock

from desplat_ns.backend import RenderSettings, resolve
from desplat_ns.backend.numba_kernels import compiling, passes
from desplat_ns.backend.numba_kernels import runtime as numba_runtime
from desplat_ns.backend.numba_kernels.launches import Launch, launches
from desplat_ns.backend.numba_kernels.runtime import (
    before_first_launch,
    kernel,
    kernels,
    numba_config,
)
from desplat_ns.backend.over import in_range, over
from desplat_ns.backend.ssim import ssim
from desplat_ns.gaussians.distractor_config import DistractorConfig
from tests.backend.scenes import random_scene
from tests.helpers.well_known_scene import WellKnownScene


def test_every_kernel_that_a_step_launches_is_compiled_beforehand_with_its_types():
    scene = random_scene(0, count=3)
    parts = {k: v for k, v in vars(scene.splats).items() if isinstance(v, torch.Tensor)}
    parts |= {"colors": torch.zeros(3, 4, 3)}
    leaves = {name: tensor.float().requires_grad_() for name, tensor in parts.items()}
    splats = replace(scene.splats, **leaves, sh_degree=1)
    for settings in (RenderSettings(), RenderSettings(depth=True, antialiased=True, absgrad=True)):
        drawn = resolve("numba", "cpu")(splats, scene.view, settings)
        image = in_range(over(drawn.rgb, drawn.alpha, torch.zeros(3)))
        photo = torch.zeros(16, 16, 3, requires_grad=True)
        (ssim(photo, torch.zeros(16, 16, 3)) + image.sum()).backward()
    WellKnownScene().find(torch.rand(40, 60, 3), 40, DistractorConfig(start="residual"))
    known = {launch.kernel: launch.types for launch in launches()}
    assert compiling.have_compiled in before_first_launch
    assert {kernel for kernel in kernels if kernel.targetoptions.get("parallel")} <= set(known)
    assert [kernel for kernel, types in known.items() if types not in kernel.signatures] == []
    assert len(passes.draw_frame.signatures) == len(passes.backward_frame.signatures) == 1


def test_what_another_processor_left_in_the_cache_is_no_kernel_here(monkeypatch):
    scene = random_scene(0, count=3)
    resolve("numba", "cpu")(scene.splats, scene.view, RenderSettings())
    (draw,) = (launch for launch in launches() if launch.kernel is passes.draw_frame)
    assert compiling.is_cached(draw)
    other = ("x86_64", "another processor", "")
    monkeypatch.setattr(type(draw.kernel.targetctx.codegen()), "magic_tuple", lambda self: other)
    assert not compiling.is_cached(draw)


class Kernel:
    """What is known of a kernel before it is compiled."""

    def __init__(self, module: str, folder: str | None) -> None:
        self.py_func = SimpleNamespace(__module__=module)
        self.stats = SimpleNamespace(cache_path=folder)


class Cache:
    """Two kernels in each of three modules; a worker compiles a module in two steps."""

    def __init__(self, folder: str | None) -> None:
        self.launches = [Launch(Kernel(m, folder), []) for m in "abc" for _ in range(2)]
        self.there: list[Launch] = []
        self.started: list[str] = []
        self.most_at_once = self.working = 0

    def start(self, module: str) -> compiling.Worker:
        cache = self
        cache.started.append(module)
        cache.working += 1
        cache.most_at_once = max(cache.most_at_once, cache.working)
        todo = [launch for launch in cache.launches if launch.module == module]

        class Worker:
            def poll(self) -> int | None:
                if todo:
                    cache.there.append(todo.pop(0))
                    return None
                cache.working -= 1
                return 0

            def kill(self) -> None: ...

        return Worker()


@pytest.fixture
def new_machine(monkeypatch, tmp_path):
    """`new_machine(folder)`: nothing is compiled there; two cores, no time between two looks."""

    def prepare(folder: str | None = str(tmp_path)) -> Cache:
        cache = Cache(folder)
        monkeypatch.setattr(compiling, "launches", lambda: cache.launches)
        monkeypatch.setattr(compiling, "is_cached", lambda launch: launch in cache.there)
        monkeypatch.setattr(compiling, "_start", cache.start)
        monkeypatch.setattr(compiling, "cores", lambda: 2)
        monkeypatch.setattr(compiling, "PAUSE", 0)
        return cache

    return prepare


def test_each_module_is_compiled_once_by_as_many_processes_as_there_are_cores(new_machine, capsys):
    cache = new_machine()
    compiling.have_compiled()
    assert cache.started == ["a", "b", "c"] and cache.most_at_once == 2
    assert len(cache.there) == 6
    first, *_, last = capsys.readouterr().err.splitlines()
    assert first == "Compiling the numba kernels for this CPU, once: 0 of 6, 0 s"
    assert last == "Compiling the numba kernels for this CPU, once: 6 of 6, 0 s"


def test_nothing_is_said_or_compiled_where_all_kernels_lie_in_the_cache(new_machine, capsys):
    cache = new_machine()
    cache.there = list(cache.launches)
    compiling.have_compiled()
    assert cache.started == [] and capsys.readouterr().err == ""


def test_a_module_of_which_a_kernel_is_missing_is_compiled_alone(new_machine, capsys):
    cache = new_machine()
    cache.there = [launch for launch in cache.launches if launch is not cache.launches[3]]
    compiling.have_compiled()
    assert cache.started == ["b"]
    assert "0 of 1" in capsys.readouterr().err


def test_no_other_process_compiles_what_it_could_not_hand_over(new_machine, capsys):
    cache = new_machine(None)
    compiling.have_compiled()
    assert cache.started == [] and "Compiling" in capsys.readouterr().err


def test_a_machine_that_starts_no_other_process_compiles_by_itself(new_machine, monkeypatch):
    def refuse(module):
        raise OSError("no processes")

    cache = new_machine()
    monkeypatch.setattr(compiling, "_start", refuse)
    compiling.have_compiled()
    assert cache.there == []


def test_processes_that_get_nothing_done_are_ended(new_machine, monkeypatch):
    killed = []
    stuck = SimpleNamespace(poll=lambda: None, kill=lambda: killed.append(True))
    new_machine()
    monkeypatch.setattr(compiling, "_start", lambda module: stuck)
    monkeypatch.setattr(compiling, "PATIENCE", 0.0)
    compiling.have_compiled()
    assert killed == [True, True]


def test_a_process_that_finds_another_one_compiling_waits_for_its_kernels(
    new_machine, monkeypatch, tmp_path
):
    cache, looks = new_machine(), []

    def sleep(_: float) -> None:
        looks.append(len(cache.there))
        cache.there.append(cache.launches[len(cache.there)])

    monkeypatch.setattr(compiling, "time", SimpleNamespace(monotonic=time.monotonic, sleep=sleep))
    with FileLock(tmp_path / ".compiling.lock"):
        compiling.have_compiled()
    assert cache.started == [] and looks == [0, 1, 2, 3, 4, 5]


def test_elsewhere_the_package_that_this_process_imports_is_compiled(monkeypatch):
    """`python -c` and notebooks have "" on their path: the folder they were started in."""
    started = []

    def start(command, env, **how):
        started.append((command, env))
        return SimpleNamespace(poll=lambda: 0, kill=lambda: None)

    monkeypatch.setattr(compiling.sys, "platform", "darwin")
    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(sys, "path", ["", "/elsewhere"])
    compiling._start("module")
    ((command, environment),) = started
    assert command == [sys.executable, "-m", compiling.__name__, "module"]
    assert environment["PYTHONPATH"] == os.pathsep.join([os.getcwd(), "/elsewhere"])


@pytest.mark.skipif(sys.platform != "linux", reason="forks on Linux only")
def test_a_forked_process_does_its_work_and_ends(monkeypatch, tmp_path):
    monkeypatch.setattr(compiling, "compile_module", lambda name: (tmp_path / name).touch())
    worker = compiling.Forked("done")
    until = time.monotonic() + 60
    while worker.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    assert worker.poll() == 0 and (tmp_path / "done").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="forks on Linux only")
def test_a_forked_process_that_hangs_can_be_ended(monkeypatch):
    monkeypatch.setattr(compiling, "compile_module", lambda name: time.sleep(600))
    worker = compiling.Forked("module")
    assert worker.poll() is None
    worker.kill()
    assert worker.poll() is not None


@pytest.mark.skipif(sys.platform != "linux", reason="forks on Linux only")
def test_a_kernel_that_another_process_compiled_is_loaded_here(monkeypatch, tmp_path):
    (known,) = (launch for launch in launches() if launch.kernel is passes.sum_rows)
    monkeypatch.setattr(numba_config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(numba_runtime, "kernels", [])
    launch = Launch(kernel(parallel=True)(passes.sum_rows.py_func), known.arguments)
    monkeypatch.setattr(compiling, "launches", lambda: (launch,))
    assert not compiling.is_cached(launch)
    compiling.have_compiled()
    assert compiling.is_cached(launch)
    launch.kernel.compile(launch.types)
    assert sum(launch.kernel.stats.cache_hits.values()) == 1
