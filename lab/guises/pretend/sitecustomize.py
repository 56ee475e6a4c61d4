"""Makes an interpreter believe in another machine; read at its start where this folder is on the
path. `lab.guises` sets the variables.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from typing import Any

CORES = int(os.environ.get("DESPLAT_NS_PRETEND_CORES", "0"))
GPU = os.environ.get("DESPLAT_NS_PRETEND_GPU")


class _TorchSeesAGpu(MetaPathFinder):
    """Once `torch.cuda` is imported it says that there is a GPU, unless GPUs are hidden."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        if fullname != "torch.cuda":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        assert spec is not None and spec.loader is not None
        load = spec.loader.exec_module

        def load_and_pretend(module: Any) -> None:
            load(module)
            module.is_available = lambda: os.environ.get("CUDA_VISIBLE_DEVICES") != ""

        spec.loader.exec_module = load_and_pretend
        return spec


if CORES:
    os.cpu_count = lambda: CORES
    os.sched_getaffinity = lambda pid: set(range(CORES))
if GPU:
    sys.meta_path.insert(0, _TorchSeesAGpu())
