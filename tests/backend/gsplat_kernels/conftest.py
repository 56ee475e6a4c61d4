"""A machine that has what compiles CUDA code: folders with scripts that answer as the real ones."""

from __future__ import annotations

import os
import sysconfig
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from desplat_ns.backend.gsplat_kernels import tools

Toolkit = Callable[..., Path]


def script(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def toolkit(tmp_path: Path) -> Toolkit:
    """`toolkit("13.2", "place")`: a toolkit as a wheel brings it; its folder."""

    def make(release: str, place: str = "toolkit") -> Path:
        home = tmp_path / place
        script(home / "bin" / "nvcc", f"echo 'Cuda compilation tools, release {release}, V1'")
        (home / "include").mkdir()
        (home / "include" / "cusparse.h").touch()
        (home / "lib").mkdir()
        (home / "lib" / f"libcudart.so.{release.partition('.')[0]}").touch()
        return home

    return make


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine without any toolkit, for a torch of CUDA 13.2: ninja, g++ 12.2 and Python's headers
    are there. Its folder of programs, the only one on PATH."""
    programs = tmp_path / "programs"
    script(programs / "ninja", "echo 1.13")
    gxx(programs, "12.2.0")
    (tmp_path / "python").mkdir()
    (tmp_path / "python" / "Python.h").touch()
    monkeypatch.setattr(torch.version, "cuda", "13.2")
    monkeypatch.setattr(tools, "_in_wheels", lambda pattern: [])
    folders = {"include": str(tmp_path / "python"), "scripts": str(programs)}
    monkeypatch.setattr(sysconfig, "get_path", lambda name, *_: folders[name])
    monkeypatch.setattr(tools.sys, "executable", str(programs / "python"))
    for name in ("CUDA_HOME", "CUDA_PATH", "CXX", "CC", "LIBRARY_PATH", "CPATH", "MAX_JOBS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PATH", str(programs) + os.pathsep + "/nowhere")
    monkeypatch.setattr(tools, "SYSTEM_TOOLKIT", tmp_path / "usr" / "local" / "cuda")
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path / "extensions"))
    monkeypatch.delenv("TORCH_CUDA_ARCH_LIST", raising=False)
    return programs


def gxx(programs: Path, release: str, name: str = "c++") -> Path:
    """A compiler of GNU's that has this version."""
    answer = f'case "$1" in -dump*) echo {release};; *) echo "{name} (Debian) {release}";; esac'
    return script(programs / name, answer)
