"""gsplat's CUDA kernels, which gsplat compiles by itself: half an hour of one core, once for each
version of torch and kind of GPU. It looks for nvcc on PATH alone, and a process that begins throws
away what another one has compiled. Here nvcc is found, and one process compiles at a time."""

import importlib
import importlib.util
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import torch
from filelock import FileLock

from desplat_ns.core.cores import cores, memory

BYTES_A_JOB = 4 << 30
"""Of memory that one compiler may need."""

LAST_LINES = 5
"""Of a compiler's complaints that the text repeats."""

TEXT = """has no CUDA kernels here: {why}
Compiling them needs nvcc of torch's CUDA, which is {cuda} (`pip install 'desplat-ns[cuda]'` brings
that of CUDA 13, https://developer.nvidia.com/cuda-downloads any), and g++ with Python's headers
(`apt install g++ python3-dev`). CUDA_HOME names a toolkit, CXX and CC a compiler, and MAX_JOBS=1
needs the least memory. `python -m desplat_ns.backend.compile_kernels` tries again."""


@cache
def unavailable_reason() -> str | None:
    """Why gsplat has no kernels, and what to install; None once they are loaded. The first call on
    a machine compiles them."""
    with suppress(ImportError, OSError):
        importlib.import_module("gsplat.csrc")  # a wheel with kernels
        return None
    home = next(cuda_homes(), None)
    if home is None:
        return _text("there is no nvcc in CUDA_HOME, this environment, PATH or /usr/local/cuda.")
    from torch.utils import cpp_extension

    cpp_extension.CUDA_HOME = str(home)
    try:
        folder = Path(cpp_extension._get_build_directory("gsplat_cuda", verbose=False))
        with FileLock(folder.with_suffix(".lock")), _variables(home, folder):
            if not (folder / "gsplat_cuda.so").exists():
                print(
                    f"gsplat compiles its CUDA kernels with {home}/bin/nvcc, once: half an hour "
                    f"of one core. They are kept in {folder}.",
                    flush=True,
                )
            importlib.import_module("gsplat.cuda._backend")
    except (ImportError, OSError, RuntimeError) as error:
        lines = [line.strip() for line in str(error).splitlines()] or [type(error).__name__]
        bad = [line for line in lines if "error" in line.lower() or "Killed" in line] or lines
        return _text("\n".join(f"    {line[:300]}" for line in ["", *bad[-LAST_LINES:]]))
    return None


def cuda_homes() -> Iterator[Path]:
    """Folders of CUDA toolkits with bin/nvcc, the preferred one first: a named one, that of the
    nvidia-cuda-nvcc wheel, which fits torch, then the system's."""
    places = [Path(os.environ[name]) for name in ("CUDA_HOME", "CUDA_PATH") if os.environ.get(name)]
    wheels = importlib.util.find_spec("nvidia")
    for folder in (wheels.submodule_search_locations or ()) if wheels is not None else ():
        places += sorted(Path(folder).glob("cu*"))
    nvcc = shutil.which("nvcc")
    places += [Path(nvcc).parent.parent] if nvcc else []
    yield from (p for p in (*places, Path("/usr/local/cuda")) if (p / "bin" / "nvcc").exists())


@contextmanager
def _variables(home: Path, folder: Path) -> Iterator[None]:
    """The environment under which gsplat, torch and ninja find the toolkit; as before afterwards.
    Beside the kernels lies a link to wheels' libcudart.so.13 by the name that the linker asks
    for."""
    before = dict(os.environ)
    jobs = min(cores(), max(1, memory()[1] // BYTES_A_JOB))
    links = folder.parent / "links"
    for runtime in home.glob("lib/libcudart.so.*"):
        links.mkdir(exist_ok=True)
        (links / "libcudart.so").unlink(missing_ok=True)
        (links / "libcudart.so").symlink_to(runtime)
    folders = {"PATH": [home / "bin", Path(sys.executable).parent], "LIBRARY_PATH": [links]}
    for name, first in folders.items():
        os.environ[name] = os.pathsep.join(filter(None, [*map(str, first), before.get(name)]))
    os.environ.update({"CUDA_HOME": str(home), "MAX_JOBS": before.get("MAX_JOBS", str(jobs))})
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _text(why: str) -> str:
    return TEXT.format(why=why, cuda=torch.version.cuda)
