"""Compile gsplat's CUDA kernels on a machine without a GPU, and check them as far as one can there.

make gpu-build                             for compute capability 8.9
make gpu-build GPU_BUILD_ARGS='--architecture 9.0'

They are compiled by the code that a run on a GPU uses, linked, loaded, and called with every call
that the gsplat backend makes, recorded: a call that fits ends at gsplat's own check for a CUDA
tensor. Where no toolkit can be had nothing is compiled, and that is said. docs/dev/environment.md
says what is known by this, and what only a card can tell.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import gsplat
import torch
from torch import Tensor

from desplat_ns.backend.gsplat_kernels.build import Target, library_for
from desplat_ns.backend.gsplat_kernels.kernels import load
from desplat_ns.backend.gsplat_kernels.tools import NoKernels, find_tools
from lab.arguments import parser_of
from lab.documents import CHECKOUT
from lab.gpu.declarations import misfits, read_declarations
from lab.gpu.recorded_calls import Call, record

ARCHITECTURE = "8.9"
"""Compute capability that kernels are compiled for without a GPU."""

TOOLKIT = CHECKOUT / "outputs" / "gpu-toolkit"
"""Where nvcc is installed if the environment has none."""

NOT_ON_A_GPU = ("must be a CUDA tensor", "non-CUDA DeviceType")
"""What a kernel says of tensors on the CPU once it has taken them: gsplat's own check, or torch's
guard of the device."""


def have_toolkit() -> None:
    """See to it that `find_tools` finds a toolkit: install one beside the checkout if need be.

    Raises:
        NoKernels: there is none to be had, or something else is missing.
    """
    if not list(TOOLKIT.glob("nvidia/*/bin/nvcc")):
        try:
            find_tools()
            return
        except NoKernels as reason:
            if "desplat-ns[cuda]" not in str(reason):
                raise
            _install(f"cuda-toolkit[nvcc]=={torch.version.cuda}.*")
    for nvcc in TOOLKIT.glob("nvidia/*/bin/nvcc"):
        os.environ["CUDA_HOME"] = str(nvcc.parent.parent)
    find_tools()


def _install(wheel: str) -> None:
    """Into a folder of its own: the environment stays as it is. What fails is found missing."""
    uv = shutil.which("uv")
    command = [sys.executable, "-m", "pip", "install"]
    if uv is not None:
        command = [uv, "pip", "install", "--python", sys.executable]
    print(f"Installing {wheel} into {TOOLKIT} (283 MB)", flush=True)
    subprocess.run([*command, "--quiet", "--target", str(TOOLKIT), wheel])


def refused(module: ModuleType, call: Call) -> str | None:
    """Why a compiled kernel does not take a call's values; None where it takes them, and then says
    that they are on no GPU."""
    kernel = getattr(module, call.kernel, None)
    if kernel is None:
        return f"{call.kernel} is not in the compiled module"
    values = [
        module.CameraModelType.PINHOLE if value == "PINHOLE" else value
        for value in (v.detach() if isinstance(v, Tensor) else v for v in call.values)
    ]
    try:
        kernel(*values)
    except TypeError as error:  # pybind11: no such signature
        return f"{call.kernel}: {error}"
    except RuntimeError as error:
        if any(said in str(error) for said in NOT_ON_A_GPU):
            return None
        return f"{call.kernel}: {error}"
    return f"{call.kernel} drew on the CPU"


def check(module: ModuleType | None) -> tuple[list[str], Counter[str]]:
    """What does not fit, and how many calls of each kernel were compared.

    Args:
        module: the compiled kernels; None to compare with the sources' declarations alone.
    """
    declared = read_declarations(Path(gsplat.__file__).parent)
    calls = record(declared)
    bad: list[str] = []
    for call in calls:
        bad += misfits(call.kernel, declared[call.kernel], call.values)
    if module is not None:
        bad += filter(None, (refused(module, call) for call in calls))
    return list(dict.fromkeys(bad)), Counter(call.kernel for call in calls)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 1 where kernels cannot be compiled with the tools that are there, or a call does
    not fit; 0 as well where there are no tools."""
    parser = parser_of("python -m lab.gpu.gpu_build", __doc__)
    parser.add_argument("--architecture", default=ARCHITECTURE, help="(%(default)s)")
    target = Target.here(parser.parse_args(arguments).architecture)
    module = None
    try:
        if not target.library.exists():
            have_toolkit()
    except NoKernels as reason:
        print(f"Skipped, nothing is compiled: gsplat {reason}")
    else:
        try:
            module = load(library_for(target))
        except NoKernels as reason:
            print(f"Error: gsplat {reason}", file=sys.stderr)
            return 1
        print(f"Loaded: {target.library}")
    bad, calls = check(module)
    compared = "compiled kernels" if module is not None else "declarations in gsplat's sources"
    for name, count in calls.items():
        print(f"{name}: {count} calls compared with the {compared}")
    for line in bad:
        print(f"Error: {line}", file=sys.stderr)
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
