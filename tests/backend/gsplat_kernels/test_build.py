"""The build with made-up compilers: what is said, kept and remembered of it."""

from __future__ import annotations

import os
import shutil
import sys
import sysconfig
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from desplat_ns.backend.gsplat_kernels import build
from desplat_ns.backend.gsplat_kernels.build import Target, jobs, library_for
from desplat_ns.backend.gsplat_kernels.tools import NoKernels
from tests.backend.gsplat_kernels.conftest import gxx, script

REAL_PYTHON, REAL_PATH = sys.executable, os.environ["PATH"]
REAL_HEADERS, GCC = sysconfig.get_path("include"), shutil.which("gcc")

SOUND = """
import os, pathlib, time
folder = pathlib.Path(os.environ["TORCH_EXTENSIONS_DIR"], "gsplat_cuda")
folder.mkdir(exist_ok=True)
with open(folder.parent / "calls", "a") as calls:
    print(os.environ["MAX_JOBS"], os.environ["TORCH_CUDA_ARCH_LIST"], file=calls)
(folder / "build.ninja").write_text("".join(f"build file{n}.o: compile\\n" for n in range(2)))
for n in range(2):
    (folder / f"file{n}.o").touch()
    time.sleep(PAUSE)
(folder / "gsplat_cuda.so").write_text("kernels")
"""
FAILING = """
print("[3/26] nvcc ...")
print("some.cu(7): error: identifier \\"xyz\\" is undefined")
print("1 error detected in the compilation of some.cu.")
raise RuntimeError("Error building extension")
"""


@pytest.fixture
def target(toolkit, machine, monkeypatch) -> Target:
    """Kernels that are not there, on a machine that can compile them."""
    toolkit("13.2", "usr/local/cuda")
    monkeypatch.setattr(build.sys, "executable", REAL_PYTHON)
    compiler_says(monkeypatch, SOUND)
    return Target.here("8.9")


def compiler_says(monkeypatch: pytest.MonkeyPatch, program: str, pause: float = 0.0) -> None:
    monkeypatch.setattr(build, "COMPILE", program.replace("PAUSE", str(pause)))


def calls(target: Target) -> list[str]:
    path = target.folder / "calls"
    return path.read_text().splitlines() if path.exists() else []


def test_kernels_are_compiled_once_and_then_need_no_tools(target, machine, capsys, monkeypatch):
    monkeypatch.setenv("MAX_JOBS", "3")
    library = library_for(target)
    assert library.read_text() == "kernels" and calls(target) == ["3 8.9"]
    said = capsys.readouterr().out
    assert "compute capability 8.9 with nvcc 13.2: about 11 minutes, 3 at a time, once" in said
    assert f"Log: {target.folder / 'log.txt'}" in said
    assert not (target.folder / "gsplat_cuda").exists()  # the files on the way
    (machine / "ninja").unlink()
    assert library_for(target) == library and capsys.readouterr().out == ""


@pytest.mark.slow
def test_progress_is_said_on_the_way(target, capsys, monkeypatch):
    compiler_says(monkeypatch, SOUND, pause=2.5)
    library_for(target)
    assert "1 of 2 files after" in capsys.readouterr().out


def test_another_gpu_or_another_version_has_kernels_of_its_own(target):
    others = [Target.here("9.0"), Target("8.9", "1.5.3", target.torch, target.python)]
    others += [Target("8.9", target.gsplat, "2.99", target.python)]
    others += [Target("8.9", target.gsplat, target.torch, "3.99"), Target.here("8.9;9.0+PTX")]
    assert len({other.folder for other in [target, *others]}) == 6
    assert all(other.folder.parent == target.folder.parent for other in others)


def test_a_failure_is_told_by_the_compilers_own_lines_and_remembered(target, monkeypatch, capsys):
    compiler_says(monkeypatch, FAILING)
    with pytest.raises(NoKernels) as error:
        library_for(target)
    first = str(error.value)
    assert "compiling them failed (nvcc 13.2 in " in first and "c++ (Debian) 12.2.0)" in first
    assert f"of {target.folder / 'log.txt'}" in first
    assert '    some.cu(7): error: identifier "xyz" is undefined' in first.splitlines()
    assert "Compiling" in capsys.readouterr().out

    compiler_says(monkeypatch, SOUND)
    with pytest.raises(NoKernels) as error:
        library_for(target)
    assert str(error.value).startswith(first) and build.AGAIN in str(error.value)
    assert capsys.readouterr().out == "" and calls(target) == []


def test_a_compiler_that_was_killed_is_not_remembered_and_fewer_at_once_are_proposed(
    target, monkeypatch
):
    compiler_says(monkeypatch, "print('c++: fatal error: Killed signal'); raise SystemExit(1)")
    with pytest.raises(NoKernels, match=r"Killed signal.*\n*MAX_JOBS=1"):
        library_for(target)
    compiler_says(monkeypatch, SOUND)
    assert library_for(target).exists()


def test_a_full_disk_is_no_traceback(target, monkeypatch):
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(build, "_run", full)
    with pytest.raises(NoKernels, match=r"No space left on device.*TORCH_EXTENSIONS_DIR"):
        library_for(target)


@pytest.mark.parametrize("is_asked", [True, False], ids=["when it is asked", "with other tools"])
def test_a_failure_is_forgotten(target, machine, monkeypatch, is_asked):
    build.forget_failure(target)  # nothing to forget
    compiler_says(monkeypatch, FAILING)
    with pytest.raises(NoKernels):
        library_for(target)
    compiler_says(monkeypatch, SOUND)
    build.forget_failure(target) if is_asked else gxx(machine, "13.1.0")
    assert library_for(target).exists()


@pytest.mark.slow
def test_of_two_processes_one_compiles_and_the_other_waits(target, monkeypatch, capsys):
    compiler_says(monkeypatch, SOUND, pause=1.0)
    threads = [threading.Thread(target=library_for, args=(target,)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(calls(target)) == 1 and target.library.exists()
    assert "Another process compiles gsplat's kernels" in capsys.readouterr().out


def test_a_folder_that_cannot_be_written_is_named(target, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path / "file"))
    with pytest.raises(NoKernels, match=r"written to .*file/gsplat.*TORCH_EXTENSIONS_DIR"):
        library_for(target)


@pytest.mark.parametrize(
    ("cores", "gib", "expected"),
    [(16, 64, 16), (96, 960, 25), (16, 15.9, 3), (2, 64, 2), (8, 1, 1)],
)
def test_as_many_files_at_once_as_memory_and_cores_allow(
    monkeypatch, tmp_path, cores, gib, expected
):
    class Memory:
        available = int(gib * 2**30)

    monkeypatch.delenv("MAX_JOBS", raising=False)
    monkeypatch.setattr(build.os, "sched_getaffinity", lambda process: range(cores), raising=False)
    monkeypatch.setattr(build.psutil, "virtual_memory", Memory)
    monkeypatch.setattr(build, "CONTAINERS_MEMORY", tmp_path / "memory.max")
    assert jobs() == expected
    (tmp_path / "memory.max").write_text("max\n")
    assert jobs() == expected
    (tmp_path / "memory.max").write_text(f"{8 << 30}\n")
    assert jobs() == min(expected, 2)
    monkeypatch.setenv("MAX_JOBS", "5")
    assert jobs() == 5


def test_without_words_that_sound_like_errors_the_last_lines_are_told(tmp_path):
    log = tmp_path / "log.txt"
    log.write_text("".join(f"line {n}\n\n" for n in range(20)))
    assert build._complaints(log).split() == " ".join(f"line {n}" for n in range(14, 20)).split()


MODULE = """
#define PY_SSIZE_T_CLEAN
#include <Python.h>
static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "gsplat_cuda", 0, -1, 0};
PyMODINIT_FUNC PyInit_gsplat_cuda(void) { return PyModule_Create(&definition); }
"""


@pytest.mark.slow
@pytest.mark.skipif(GCC is None, reason="needs gcc")
@pytest.mark.skipif(not Path(REAL_HEADERS, "Python.h").exists(), reason="needs Python.h")
def test_gsplats_own_code_compiles_with_the_tools_that_were_found(
    toolkit: Callable[..., Path], machine: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """gsplat, torch and ninja are the real ones; nvcc and c++ write down that they were called, and
    what they link is a module without contents."""
    home, record = toolkit("13.2", "usr/local/cuda"), tmp_path / "compiled"
    (tmp_path / "module.c").write_text(MODULE)
    object_file = 'while [ "$1" != -o ]; do shift; done; touch "$2"; echo "$2" >> ' + str(record)
    answer = "case $1 in --version) echo 'release 13.2, V13.2.86'; exit;; esac\n"
    script(home / "bin" / "nvcc", f"{answer}{object_file}")
    gcc = f"{GCC} -shared -fPIC -I{REAL_HEADERS} {tmp_path / 'module.c'}"
    answer = "case $1 in -dump*) echo 12.2.0; exit;; -v|--version) echo g++; exit;; esac\n"
    link = f'case "$*" in *" -shared "*) exec {gcc} -o gsplat_cuda.so;; esac\n'
    script(machine / "c++", f"{answer}{link}{object_file}")
    monkeypatch.setattr(build.sys, "executable", REAL_PYTHON)
    monkeypatch.setenv("PATH", f"{machine}{os.pathsep}{REAL_PATH}")
    real_ninja = shutil.which("ninja", path=f"{Path(REAL_PYTHON).parent}{os.pathsep}{REAL_PATH}")
    assert real_ninja is not None  # gsplat requires it
    script(machine / "ninja", f'exec {real_ninja} "$@"')
    target = Target.here("8.9")
    try:
        library = library_for(target)
    except NoKernels as error:
        pytest.fail(str(error))
    assert library.stat().st_size > 1000
    compiled = record.read_text().split()
    assert len(compiled) == len(set(compiled)) > 20 and "ext.o" in compiled
