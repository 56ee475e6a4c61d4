"""Makes an interpreter believe in another machine; read at its start where this folder is on the
path. `lab.guises` sets the variables.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from typing import Any

CORES = int(os.environ.get("DESPLAT_NS_PRETEND_CORES", "0"))
GPU = os.environ.get("DESPLAT_NS_PRETEND_GPU")
NO_BFLOAT16 = os.environ.get("DESPLAT_NS_PRETEND_NO_BFLOAT16")


class _Says(MetaPathFinder):
    """Once a module is imported, some of its functions say something else."""

    def __init__(self, module: str, **answers: Callable[[], bool]) -> None:
        self.module, self.answers = module, answers

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        if fullname != self.module:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        assert spec is not None and spec.loader is not None
        load = spec.loader.exec_module

        def load_and_pretend(module: Any) -> None:
            load(module)
            vars(module).update(self.answers)

        spec.loader.exec_module = load_and_pretend
        return spec


if CORES:
    os.cpu_count = lambda: CORES
    os.sched_getaffinity = lambda pid: set(range(CORES))
if GPU:
    is_visible = lambda: os.environ.get("CUDA_VISIBLE_DEVICES") != ""  # noqa: E731
    sys.meta_path.insert(0, _Says("torch.cuda", is_available=is_visible))
if NO_BFLOAT16:
    names = ("_is_avx512_bf16_supported", "_is_amx_tile_supported")
    sys.meta_path.insert(0, _Says("torch.cpu", **dict.fromkeys(names, lambda: False)))
