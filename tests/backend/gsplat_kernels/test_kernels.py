from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import torch

from desplat_ns.backend.gsplat_kernels import kernels
from desplat_ns.backend.gsplat_kernels.build import Target
from desplat_ns.backend.gsplat_kernels.tools import NoKernels


@pytest.fixture(autouse=True)
def _nothing_is_kept():
    kernels.unavailable_reason.cache_clear()
    yield
    kernels.unavailable_reason.cache_clear()


@pytest.fixture
def gpus(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Compute capabilities of the GPUs; torch works up to 12.0."""
    capabilities: list[tuple[int, int]] = [(8, 9)]
    monkeypatch.delenv("TORCH_CUDA_ARCH_LIST", raising=False)
    monkeypatch.setattr(torch.cuda, "get_arch_list", lambda: ["sm_75", "sm_90", "sm_120"])
    monkeypatch.setattr(torch.cuda, "device_count", lambda: len(capabilities))
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda device: capabilities[device])
    return capabilities


def test_kernels_are_compiled_for_the_gpus_at_hand(gpus, monkeypatch):
    assert kernels.architectures() == "8.9"
    gpus += [(9, 0), (8, 9)]
    assert kernels.architectures() == "8.9;9.0"
    gpus[:] = [(13, 0)]  # later than this torch
    assert kernels.architectures() == "12.0+PTX"
    monkeypatch.setenv("TORCH_CUDA_ARCH_LIST", "8.0 8.6")
    assert kernels.architectures() == "8.0 8.6"


def no_kernels(target: Target) -> Path:
    raise NoKernels("has no nvcc.")


def test_a_reason_is_looked_for_once_in_a_process_and_again_when_asked(gpus, monkeypatch):
    asked = []

    def library_for(target: Target) -> Path:
        asked.append(target.architectures)
        return no_kernels(target)

    monkeypatch.setattr(kernels, "library_for", library_for)
    forgotten: list[Any] = []
    monkeypatch.setattr(kernels, "forget_failure", forgotten.append)
    for _ in range(2):
        assert kernels.unavailable_reason() == "has no nvcc."
    assert asked == ["8.9"]
    kernels.try_again()
    assert kernels.unavailable_reason() == "has no nvcc." and len(asked) == 2
    assert [target.architectures for target in forgotten] == ["8.9"]


def test_a_file_that_is_no_module_says_what_to_remove(tmp_path):
    library = tmp_path / "gsplat_cuda.so"
    library.write_text("not compiled")
    with pytest.raises(NoKernels, match=rf"cannot load .* Remove {tmp_path}"):
        kernels.load(library)


def test_gsplat_calls_what_was_loaded(gpus, monkeypatch, tmp_path):
    """gsplat itself has none here; afterwards its wrapper finds ours."""
    import gsplat
    from gsplat.cuda._wrapper import _make_lazy_cuda_func

    module: Any = ModuleType("gsplat_cuda")
    module.isect_tiles = lambda *arguments: ("called", *arguments)
    monkeypatch.setattr(kernels, "library_for", lambda target: tmp_path)
    monkeypatch.setattr(kernels, "load", lambda library: module)
    monkeypatch.setattr(gsplat, "csrc", None, raising=False)  # put back afterwards
    monkeypatch.setitem(sys.modules, "gsplat.csrc", None)  # as if there were none
    monkeypatch.delitem(sys.modules, "gsplat.cuda._backend", raising=False)
    assert kernels.unavailable_reason() is None
    assert _make_lazy_cuda_func("isect_tiles")(3) == ("called", 3)


def test_a_gsplat_that_brings_its_kernels_has_nothing_compiled(gpus, monkeypatch):
    monkeypatch.setattr(kernels, "library_for", no_kernels)
    assert kernels.unavailable_reason() == "has no nvcc."
    kernels.unavailable_reason.cache_clear()
    monkeypatch.setitem(sys.modules, "gsplat.csrc", ModuleType("gsplat.csrc"))
    assert kernels.unavailable_reason() is None
