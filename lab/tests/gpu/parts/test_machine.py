from __future__ import annotations

import subprocess
from types import SimpleNamespace

import pytest
import torch

from desplat_ns.backend.gsplat_kernels.tools import NoKernels
from lab.gpu.parts import machine
from lab.gpu.plan import Job


def test_a_gpu_is_described_by_name_memory_capability_and_driver(monkeypatch):
    properties = SimpleNamespace(name="A GPU", total_memory=80 * 2**30)
    monkeypatch.setattr(torch.cuda, "get_device_properties", lambda index: properties)
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda index: (9, 0))
    answers = lambda command, **_: SimpleNamespace(stdout="580.1.2\n")  # noqa: E731
    monkeypatch.setattr(subprocess, "run", answers)
    assert machine.gpu() == {
        **{"GPU": "A GPU", "GPU memory": "80 GiB", "Compute capability": "9.0"},
        "Driver": "580.1.2",
    }


def test_the_compiler_is_the_one_that_compiles_the_kernels(monkeypatch):
    monkeypatch.setattr(machine, "find_tools", lambda: SimpleNamespace(cuda="13.0"))
    assert machine.compiler() == "nvcc 13.0"

    def none() -> None:
        raise NoKernels("has no nvcc.")

    monkeypatch.setattr(machine, "find_tools", none)
    assert machine.compiler() is None


def test_tools_that_are_not_there_are_no_error(monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert machine.driver() is None


@pytest.mark.slow
def test_a_stand_in_says_that_there_is_no_gpu(tmp_path):
    (figures,) = machine.measure(Job("cpu", True, str(tmp_path)))
    assert figures["GPU"].startswith("none") and figures["gsplat"] and all(figures.values())
