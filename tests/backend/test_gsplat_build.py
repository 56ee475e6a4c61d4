"""gsplat's kernels are compiled with an nvcc that is found, or one text says what is missing."""

import importlib
import importlib.util
import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from torch.utils import cpp_extension

from desplat_ns.backend import gsplat_build


def toolkit(home: Path) -> Path:
    """A folder with an nvcc, and with the runtime as NVIDIA's wheels have it."""
    for name in ("bin/nvcc", "lib/libcudart.so.13"):
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).touch()
    return home


@pytest.fixture(autouse=True)
def machine(monkeypatch, tmp_path):
    """A machine without nvcc. `machine.build`, if set, is gsplat's import, which compiles."""
    machine = SimpleNamespace(build=None)

    def import_module(name: str) -> None:
        if name == "gsplat.csrc":
            raise ImportError
        assert name == "gsplat.cuda._backend"
        machine.build()

    for name in ("CUDA_HOME", "CUDA_PATH", "MAX_JOBS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path / "extensions"))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(importlib, "import_module", import_module)
    monkeypatch.setattr(cpp_extension, "CUDA_HOME", None)
    gsplat_build.unavailable_reason.cache_clear()
    yield machine
    gsplat_build.unavailable_reason.cache_clear()


def test_a_named_toolkit_comes_before_the_wheels_and_that_before_the_systems(monkeypatch, tmp_path):
    wheel, system = toolkit(tmp_path / "nvidia" / "cu13"), toolkit(tmp_path / "system")
    spec = SimpleNamespace(submodule_search_locations=[str(tmp_path / "nvidia")])
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: spec)
    monkeypatch.setattr(shutil, "which", lambda name: str(system / "bin" / "nvcc"))
    assert list(gsplat_build.cuda_homes())[:2] == [wheel, system]
    monkeypatch.setenv("CUDA_HOME", str(named := toolkit(tmp_path / "named")))
    assert next(gsplat_build.cuda_homes()) == named


def test_gsplat_compiles_with_what_was_found_and_the_process_stays_as_it_was(
    monkeypatch, tmp_path, machine, capsys
):
    seen: dict[str, str] = {}
    monkeypatch.setenv("CUDA_PATH", str(home := toolkit(tmp_path / "cuda")))
    before, machine.build = dict(os.environ), lambda: seen.update(os.environ)
    assert gsplat_build.unavailable_reason() is None
    assert dict(os.environ) == before
    assert seen["CUDA_HOME"] == str(home) == cpp_extension.CUDA_HOME
    assert seen["PATH"].split(os.pathsep)[0] == str(home / "bin")
    assert int(seen["MAX_JOBS"]) >= 1
    (links,) = seen["LIBRARY_PATH"].split(os.pathsep)[:1]
    assert (Path(links) / "libcudart.so").resolve() == home / "lib" / "libcudart.so.13"
    assert "half an hour" in capsys.readouterr().out


def test_a_compiler_that_fails_is_repeated(monkeypatch, tmp_path, machine):
    def fail() -> None:
        raise RuntimeError("[1/25] nvcc ...\n/x.cu(3): error: no such thing\nninja: stopped\n")

    monkeypatch.setenv("CUDA_HOME", str(toolkit(tmp_path / "cuda")))
    machine.build = fail
    reason = gsplat_build.unavailable_reason()
    assert reason is not None and "no such thing" in reason and "[1/25]" not in reason
