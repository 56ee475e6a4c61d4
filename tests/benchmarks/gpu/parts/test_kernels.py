from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import pytest
import torch
from torch.utils import cpp_extension

from benchmarks.gpu.parts import kernels
from benchmarks.gpu.plan import Job
from desplat_ns.errors import BackendUnavailableError


@pytest.fixture
def a_gpu(monkeypatch: pytest.MonkeyPatch) -> Any:
    """torch says what an H100 is; gsplat's module of kernels, to be filled in."""
    module: Any = ModuleType("gsplat.cuda._backend")
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda index: (9, 0))
    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", module)
    for name in ("TORCH_CUDA_ARCH_LIST", "PATH"):
        monkeypatch.setenv(name, "before")
    return module


def test_kernels_are_built_for_the_gpu_at_hand_alone(a_gpu, monkeypatch):
    import os

    a_gpu._C = object()
    kernels.build()
    assert os.environ["TORCH_CUDA_ARCH_LIST"] == "9.0"
    assert os.environ["PATH"].endswith("before")


def test_without_a_compiler_it_says_what_to_install(a_gpu):
    a_gpu._C = None
    with pytest.raises(BackendUnavailableError, match=r"Install the CUDA toolkit .* nvcc on PATH"):
        kernels.build()


def test_tools_are_looked_for_in_torchs_toolkit_first(tmp_path, monkeypatch):
    (tmp_path / "bin").mkdir()
    monkeypatch.setattr(cpp_extension, "CUDA_HOME", str(tmp_path))
    assert kernels.tool_folders()[0] == str(tmp_path / "bin")


def test_the_stand_in_draws_with_numba(tmp_path):
    (found,) = kernels.measure(Job("cpu", True, str(tmp_path)))
    assert found["seconds"] == 0.0
