"""What compiles gsplat's kernels: nvcc, ninja and g++, found and checked before anything begins."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch

FIRST_WITH_NVCC_AS_WHEEL = 13
"""Major version of CUDA; wheels of earlier ones hold no nvcc."""

SYSTEM_TOOLKIT = Path("/usr/local/cuda")
"""Where NVIDIA's installer puts it."""


class NoKernels(Exception):
    """Why there are none, and what to do: a sentence or two that "Backend 'gsplat'" begins."""


@dataclass(frozen=True)
class Tools:
    """What compiles, each of a version that fits torch."""

    home: Path
    """Folder of the CUDA toolkit, with bin/nvcc."""
    cuda: str
    """The toolkit's version, for example 13.2."""
    ninja: Path
    compiler: str
    """Path of the C++ compiler."""

    def versions(self) -> str:
        """What a build that failed depended on."""
        compiler = _answer(self.compiler, "--version").partition("\n")[0]
        return f"nvcc {self.cuda} in {self.home}, {compiler or self.compiler}"

    def environment(self, links: Path) -> dict[str, str]:
        """Variables under which gsplat and torch find these tools.

        Args:
            links: a folder for the link that the linker asks for; wheels have no libcudart.so.
        """
        before = os.environ
        path = [str(self.home / "bin"), str(self.ninja.parent), before.get("PATH", "")]
        variables = {"CUDA_HOME": str(self.home), "CXX": self.compiler}
        if "CXX" in before:  # for nvcc as well, which would take gcc from PATH
            variables["CC"] = before.get("CC", self.compiler)
        variables["PATH"] = os.pathsep.join(filter(None, path))
        folders = [*_link_to_runtime(self, links), before.get("LIBRARY_PATH", "")]
        variables["LIBRARY_PATH"] = os.pathsep.join(filter(None, folders))
        headers = [*map(str, _headers_beside(self)), before.get("CPATH", "")]
        variables["CPATH"] = os.pathsep.join(filter(None, headers))
        return {name: value for name, value in variables.items() if value}


def find_tools() -> Tools:
    """The tools of this machine.

    Raises:
        NoKernels: one is missing, or nvcc is of another CUDA than torch.
    """
    home, cuda = _find_toolkit()
    ninja = _find_ninja()
    if not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        raise NoKernels(
            "has no CUDA kernels here, and they cannot be compiled without Python's headers "
            f"(Python.h). `apt install python{sys.version_info[0]}.{sys.version_info[1]}-dev` "
            "brings them."
        )
    named = os.environ.get("CXX")
    compiler = next(filter(None, map(shutil.which, [named] if named else ["c++", "g++"])), None)
    if compiler is None:
        why = (
            f"CXX names '{named}', which is not there."
            if named
            else "`apt install g++` brings one."
        )
        raise NoKernels(f"has no CUDA kernels here, and no C++ compiler to compile them. {why}")
    return Tools(home, cuda, ninja, compiler)


def _what_brings_nvcc() -> str:
    wanted = torch.version.cuda or ""
    if int(wanted.partition(".")[0] or 0) < FIRST_WITH_NVCC_AS_WHEEL:
        place = "https://developer.nvidia.com/cuda-downloads"
        return f"Install the CUDA toolkit {wanted} from {place}."
    return "`pip install 'desplat-ns[cuda]'` brings it."


def _find_toolkit() -> tuple[Path, str]:
    """The first toolkit of torch's major version, and its own version; the same minor first."""
    wanted = torch.version.cuda or ""
    toolkits = [(home, release) for home in _toolkits() if (release := _release(home))]
    for home, release in toolkits:
        if release == wanted:
            return home, release
    for home, release in toolkits:
        if release.partition(".")[0] == wanted.partition(".")[0]:
            return home, release
    if toolkits:
        others = ", ".join(f"nvcc {release} in {home}" for home, release in toolkits)
        raise NoKernels(
            f"has no CUDA kernels here, and what could compile them is for another CUDA than "
            f"torch's {wanted}: {others}. {_what_brings_nvcc()}"
        )
    raise NoKernels(
        "has no CUDA kernels here, and no nvcc to compile them was found (in CUDA_HOME, on PATH, "
        f"in this environment, in /usr/local/cuda). {_what_brings_nvcc()}"
    )


def _toolkits() -> Iterator[Path]:
    """Folders that hold bin/nvcc, in the order in which they are preferred."""
    named = [os.environ.get(name) for name in ("CUDA_HOME", "CUDA_PATH")]
    places = [Path(name) for name in named if name]
    on_path = shutil.which("nvcc")
    if on_path:
        places.append(Path(on_path).parent.parent)
    places += sorted(folder.parent.parent for folder in _in_wheels("*/bin/nvcc"))
    places.append(SYSTEM_TOOLKIT)
    yield from (home for home in dict.fromkeys(places) if (home / "bin" / "nvcc").exists())


def _in_wheels(pattern: str) -> list[Path]:
    """Files of NVIDIA's wheels in this environment."""
    spec = importlib.util.find_spec("nvidia")
    places = spec.submodule_search_locations if spec is not None else None
    return [path for place in places or () for path in Path(place).glob(pattern)]


def _release(home: Path) -> str | None:
    """Version of a toolkit, such as 13.2; None where its nvcc does not run."""
    match = re.search(r"release (\d+\.\d+)", _answer(str(home / "bin" / "nvcc"), "--version"))
    return match[1] if match else None


def _answer(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=60).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ""


def _find_ninja() -> Path:
    # The wheel's first: another version than last time would begin an interrupted build anew.
    for path in (str(Path(sys.executable).parent), sysconfig.get_path("scripts"), None):
        ninja = shutil.which("ninja", path=path)
        if ninja:
            return Path(ninja)
    raise NoKernels(
        "has no CUDA kernels here, and no ninja to compile them. `pip install ninja` brings it."
    )


def _link_to_runtime(tools: Tools, links: Path) -> list[str]:
    """Folder to link from where the toolkit, as a wheel, has libcudart.so.13 and no libcudart.so.

    Nothing is written into the toolkit's own folder.
    """
    libraries = [tools.home / "lib64", tools.home / "lib"]
    if any((folder / "libcudart.so").exists() for folder in libraries):
        return []
    name = f"libcudart.so.{tools.cuda.partition('.')[0]}"
    places = [folder / name for folder in libraries] + _in_wheels(f"*/lib/{name}")
    real = next((path for path in places if path.exists()), None)
    if real is None:
        return []  # a system's folder may have it
    links.mkdir(parents=True, exist_ok=True)
    link = links / "libcudart.so"
    link.unlink(missing_ok=True)
    link.symlink_to(real)
    return [str(links)]


def _headers_beside(tools: Tools) -> list[Path]:
    """Folders of headers that torch's include and a toolkit of nvcc alone lacks: of cuSPARSE and
    its like, and of Thrust and CUB."""
    if (tools.home / "include" / "cusparse.h").exists():
        return []
    folders = sorted({path.parent for path in _in_wheels("*/include/cusparse.h")})
    return [*folders, *(folder / "cccl" for folder in folders if (folder / "cccl").is_dir())]
