"""The calls that the gsplat backend makes against gsplat's sources; and against its compiled
kernels, where `make gpu-build` has compiled them before."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import torch

from desplat_ns.backend import gsplat_cuda
from desplat_ns.backend.gsplat_kernels.build import Target
from desplat_ns.backend.gsplat_kernels.kernels import load
from desplat_ns.backend.gsplat_kernels.tools import NoKernels
from lab.gpu import gpu_build, recorded_calls
from lab.gpu.recorded_calls import Call

KERNELS = {
    "fully_fused_projection": ("fwd", "bwd"),
    "compute_sh": ("fwd", "bwd"),
    "isect": ("tiles", "offset_encode"),
    "rasterize_to_pixels": ("fwd", "bwd"),
}
"""That gsplat 1.4 draws with."""


@pytest.fixture(scope="module")
def compiled() -> ModuleType:
    """The compiled kernels, or a skip that says how to have them."""
    library = Target.here(gpu_build.ARCHITECTURE).library
    if not library.exists():
        pytest.skip("no compiled kernels: `make gpu-build` compiles them, in half an hour")
    return load(library)


def test_every_call_fits_what_gsplats_sources_declare():
    bad, calls = gpu_build.check(None)
    assert bad == []
    names = {f"{name}_{end}" for name, ends in KERNELS.items() for end in ends}
    assert set(calls) == names
    drawn = 2 * len(recorded_calls.all_settings())  # with and without spherical harmonics
    assert {name: drawn // 2 if "sh" in name.split("_") else drawn for name in names} == calls


def test_a_call_that_does_not_fit_is_found(monkeypatch):
    """As if the backend gave its means in another type."""
    moved = gsplat_cuda._with_unsound_behind
    wrong = lambda splats, view: moved(splats, view).double()  # noqa: E731
    monkeypatch.setattr(gsplat_cuda, "_with_unsound_behind", wrong)
    bad, _ = gpu_build.check(None)
    assert "fully_fused_projection_fwd: means is torch.float64, not torch.float32" in bad


def test_every_call_fits_the_compiled_kernels(compiled):
    assert gpu_build.check(compiled)[0] == []


def test_a_call_that_does_not_fit_the_compiled_kernels_is_found(compiled):
    for values in [(torch.zeros(3), 1, 2), ("isect_ids", 1, 2, 3), (torch.zeros(3), 1, 2, 3.5)]:
        reason = gpu_build.refused(compiled, Call("isect_offset_encode", values))
        assert reason is not None and "incompatible function arguments" in reason
    reason = gpu_build.refused(compiled, Call("no_such_kernel", ()))
    assert reason == "no_such_kernel is not in the compiled module"


def module_that(says: type[Exception] | None, text: str = "") -> Any:
    def kernel(*values: Any) -> None:
        if says is not None:
            raise says(text)

    kinds = SimpleNamespace(PINHOLE=0)
    return SimpleNamespace(CameraModelType=kinds, kernel=kernel)


def test_only_what_ends_at_the_check_for_a_gpu_was_taken():
    call = Call("kernel", (torch.zeros(3), "PINHOLE"))
    guard = "CUDAGuardImpl initialized with non-CUDA DeviceType: cpu"
    for said in ("colors must be a CUDA tensor", guard):
        assert gpu_build.refused(module_that(RuntimeError, said), call) is None
    for module in (module_that(RuntimeError, "shape"), module_that(TypeError), module_that(None)):
        assert gpu_build.refused(module, call) is not None


@pytest.fixture
def no_toolkit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """No nvcc in the environment and none compiled for; the commands that would install one."""
    commands: list[list[str]] = []

    def find_tools() -> None:
        raise NoKernels("has no CUDA kernels here, and no nvcc. `pip install 'desplat-ns[cuda]'`.")

    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path / "extensions"))
    monkeypatch.setenv("CUDA_HOME", "")
    monkeypatch.setattr(gpu_build, "TOOLKIT", tmp_path / "toolkit")
    monkeypatch.setattr(gpu_build, "find_tools", find_tools)
    monkeypatch.setattr(torch.version, "cuda", "13.2")
    monkeypatch.setattr(subprocess, "run", lambda command: commands.append(command))
    return commands


def test_where_no_toolkit_can_be_had_that_is_said_and_the_sources_are_compared(no_toolkit, capsys):
    assert gpu_build.main([]) == 0
    (command,) = no_toolkit
    assert command[-3:] == ["--target", str(gpu_build.TOOLKIT), "cuda-toolkit[nvcc]==13.2.*"]
    said = capsys.readouterr().out
    assert "Skipped, nothing is compiled: gsplat has no CUDA kernels here, and no nvcc." in said
    assert "isect_tiles: 16 calls compared with the declarations in gsplat's sources" in said


def test_a_build_that_fails_is_an_error(no_toolkit, monkeypatch, capsys):
    def library_for(target: Target) -> Path:
        raise NoKernels(f"has no CUDA kernels here: some.cu, for {target.architectures}.")

    monkeypatch.setattr(gpu_build, "find_tools", lambda: None)
    monkeypatch.setattr(gpu_build, "library_for", library_for)
    assert gpu_build.main(["--architecture", "9.0"]) == 1
    assert no_toolkit == [] and "some.cu, for 9.0." in capsys.readouterr().err


def test_a_toolkit_that_was_installed_before_is_used(no_toolkit, monkeypatch):
    nvcc = gpu_build.TOOLKIT / "nvidia" / "cu13" / "bin" / "nvcc"
    nvcc.parent.mkdir(parents=True)
    nvcc.touch()
    homes = []
    monkeypatch.setattr(
        gpu_build, "find_tools", lambda: homes.append(gpu_build.os.environ["CUDA_HOME"])
    )
    gpu_build.have_toolkit()
    assert homes == [str(nvcc.parent.parent)] and no_toolkit == []
