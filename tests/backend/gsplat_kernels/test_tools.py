from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch

from desplat_ns.backend.gsplat_kernels import tools
from desplat_ns.backend.gsplat_kernels.tools import NoKernels, find_tools
from tests.backend.gsplat_kernels.conftest import Toolkit, gxx, script

pytestmark = pytest.mark.usefixtures("machine")


def test_a_toolkit_in_cuda_home_is_found_with_all_that_goes_with_it(toolkit, machine, monkeypatch):
    home = toolkit("13.2")
    monkeypatch.setenv("CUDA_HOME", str(home))
    tools = find_tools()
    assert (tools.home, tools.cuda, tools.ninja) == (home, "13.2", machine / "ninja")
    assert tools.compiler == str(machine / "c++")
    assert tools.versions() == f"nvcc 13.2 in {home}, c++ (Debian) 12.2.0"


def test_a_toolkit_is_found_on_path_in_wheels_and_in_the_systems_place(
    toolkit: Toolkit, machine: Path, monkeypatch: pytest.MonkeyPatch
):
    home = toolkit("13.2", "usr/local/cuda")
    assert find_tools().home == home
    wheels = toolkit("13.2", "nvidia/cu13")
    monkeypatch.setattr(tools, "_in_wheels", lambda pattern: [wheels / "bin" / "nvcc"])
    assert find_tools().home == wheels
    on_path = toolkit("13.2", "on_path")
    monkeypatch.setenv("PATH", f"{machine}{os.pathsep}{on_path / 'bin'}")
    assert find_tools().home == on_path


def test_of_two_toolkits_the_one_of_torchs_version_is_taken(toolkit, monkeypatch):
    monkeypatch.setenv("CUDA_HOME", str(toolkit("12.4")))
    monkeypatch.setenv("CUDA_PATH", str(toolkit("13.0", "near")))
    assert find_tools().cuda == "13.0"
    toolkit("13.2", "usr/local/cuda")
    assert find_tools().cuda == "13.2"


def test_without_nvcc_it_says_the_one_command_that_brings_it(monkeypatch):
    with pytest.raises(NoKernels, match=r"no nvcc .* `pip install 'desplat-ns\[cuda\]'`"):
        find_tools()
    monkeypatch.setattr(torch.version, "cuda", "12.8")  # whose wheels have no nvcc
    with pytest.raises(NoKernels, match=r"Install the CUDA toolkit 12\.8 from https"):
        find_tools()


def test_an_nvcc_of_another_major_version_than_torchs_is_named(toolkit, monkeypatch):
    home = toolkit("12.4")
    monkeypatch.setenv("CUDA_HOME", str(home))
    with pytest.raises(NoKernels) as error:
        find_tools()
    assert f"another CUDA than torch's 13.2: nvcc 12.4 in {home}. `pip install" in str(error.value)


def test_an_nvcc_that_does_not_run_is_none(toolkit, monkeypatch):
    home = toolkit("13.2")
    script(home / "bin" / "nvcc", "exit 1")
    monkeypatch.setenv("CUDA_HOME", str(home))
    with pytest.raises(NoKernels, match="no nvcc"):
        find_tools()


def test_ninja_beside_this_python_needs_no_path(toolkit, machine, monkeypatch):
    toolkit("13.2", "usr/local/cuda")
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("CXX", str(machine / "c++"))
    assert find_tools().ninja == machine / "ninja"


def test_what_is_missing_beside_nvcc_is_said_with_what_brings_it(toolkit, machine, tmp_path):
    toolkit("13.2", "usr/local/cuda")
    (machine / "c++").unlink()
    with pytest.raises(NoKernels, match=r"no C\+\+ compiler .* `apt install g\+\+`"):
        find_tools()
    (tmp_path / "python" / "Python.h").unlink()
    with pytest.raises(NoKernels, match=r"Python\.h\)\. `apt install python3\.\d+-dev`"):
        find_tools()
    (machine / "ninja").unlink()
    with pytest.raises(NoKernels, match=r"no ninja .* `pip install ninja`"):
        find_tools()


def test_a_compiler_that_is_named_compiles_for_nvcc_as_well(
    toolkit, machine, monkeypatch, tmp_path
):
    toolkit("13.2", "usr/local/cuda")
    other = gxx(machine, "12.3.0", "g++-12")
    monkeypatch.setenv("CXX", "g++-12")
    variables = find_tools().environment(tmp_path / "links")
    assert variables["CXX"] == variables["CC"] == str(other)


def test_a_wheels_runtime_is_linked_under_the_name_that_the_linker_asks_for(
    toolkit, monkeypatch, tmp_path
):
    home, links = toolkit("13.2", "usr/local/cuda"), tmp_path / "links"
    monkeypatch.setenv("LIBRARY_PATH", "/before")
    for _ in range(2):
        variables = find_tools().environment(links)
    assert variables["LIBRARY_PATH"] == f"{links}{os.pathsep}/before"
    assert (links / "libcudart.so").resolve() == (home / "lib" / "libcudart.so.13").resolve()
    assert variables["CUDA_HOME"] == str(home)
    assert variables["PATH"].startswith(f"{home / 'bin'}{os.pathsep}")
    assert sorted(path.name for path in (home / "lib").iterdir()) == ["libcudart.so.13"]
    (home / "lib" / "libcudart.so").touch()
    assert find_tools().environment(links)["LIBRARY_PATH"] == "/before"


def test_headers_that_a_toolkit_of_nvcc_alone_lacks_are_taken_from_torchs_wheels(
    toolkit, monkeypatch, tmp_path
):
    home = toolkit("13.2", "usr/local/cuda")
    assert "CPATH" not in find_tools().environment(tmp_path / "links")
    (home / "include" / "cusparse.h").unlink()
    header = tmp_path / "nvidia" / "cu13" / "include" / "cusparse.h"
    wheels = {"*/include/cusparse.h": [header]}
    monkeypatch.setattr(tools, "_in_wheels", lambda pattern: wheels.get(pattern, []))
    assert find_tools().environment(tmp_path / "links")["CPATH"] == str(header.parent)
    (header.parent / "cccl").mkdir(parents=True)
    both = f"{header.parent}{os.pathsep}{header.parent / 'cccl'}"
    assert find_tools().environment(tmp_path / "links")["CPATH"] == both


def test_a_compiler_that_is_named_and_not_there_is_said(machine, toolkit, monkeypatch):
    monkeypatch.setenv("CUDA_HOME", str(toolkit("13.2")))
    monkeypatch.setenv("CXX", "g++-99")
    with pytest.raises(NoKernels, match=r"CXX names 'g\+\+-99', which is not there"):
        find_tools()
