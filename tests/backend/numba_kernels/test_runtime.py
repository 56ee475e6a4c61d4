import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
import torch
from numba.core.dispatcher import Dispatcher

from desplat_ns.backend import RenderSettings, resolve
from desplat_ns.backend.numba_kernels import binning, passes, projection, sh, ssim
from desplat_ns.backend.numba_kernels import runtime as numba_runtime
from desplat_ns.backend.numba_kernels.runtime import fma, kernel
from desplat_ns.layers import over_background
from desplat_ns.losses import photometric_losses
from tests.backend.scenes import random_scene

KERNELS = (binning, passes, projection, sh, ssim)


@pytest.mark.slow
def test_a_step_loads_every_kernel_and_compiles_none(checkout: Path):
    """What is launched to be compiled has the types that steps launch, and nothing is left out; in
    a process of its own, as this one may have compiled them."""
    numba_runtime.have_compiled()
    code = "from tests.backend.numba_kernels.test_runtime import from_cache; print(from_cache())"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=checkout, capture_output=True, text=True, check=True)
    loaded = ast.literal_eval(done.stdout.splitlines()[-1])
    assert len(loaded) >= 10
    assert [name for name, is_loaded in loaded.items() if not is_loaded] == []


def from_cache() -> dict[str, bool]:
    """Draw and pull back; of each kernel, whether it came from the cache alone, and once."""
    leaves = random_scene(0, count=3, sh_degree=2).to(torch.float32)
    for settings in (RenderSettings(), RenderSettings(True, True, True)):
        drawn = resolve("numba", "cpu")(leaves.splats, leaves.view, settings)
        image = over_background(drawn.rgb, drawn.alpha, torch.zeros_like(drawn.rgb))
        owned = (drawn.alpha > 0.5).float()
        photo = image.detach() + 0.1
        torch.stack(photometric_losses(photo, owned, 0.2, image, image)).sum().backward()
    everything = [value for module in KERNELS for value in vars(module).values()]
    kernels = [k for k in everything if isinstance(k, Dispatcher) and k.stats.cache_path]
    return {
        k.py_func.__qualname__: not k.stats.cache_misses and len(k.stats.cache_hits) == 1
        for k in kernels
    }


def test_a_changed_callee_is_another_folder_whatever_its_time(monkeypatch, tmp_path):
    here = Path(numba_runtime.__file__).parent
    copied = tmp_path / here.parent.name / here.name
    shutil.copytree(here.parent, copied.parent, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(numba_runtime, "__file__", str(copied / "runtime.py"))
    before, callee = numba_runtime._key(), copied / "ellipses.py"
    times = callee.stat().st_atime_ns, callee.stat().st_mtime_ns
    callee.write_text(callee.read_text().replace("SLACK = 2e-5", "SLACK = 3e-5"))
    os.utime(callee, ns=times)
    assert numba_runtime._key() != before


def test_a_folder_is_complete_when_all_are_compiled_and_not_before(monkeypatch, tmp_path, capsys):
    left = tmp_path / "of_a_process_that_was_ended.nbi"
    left.touch()
    monkeypatch.setattr(numba_runtime, "FOLDER", tmp_path)
    monkeypatch.setattr(
        numba_runtime, "COMPILE", "if '{}' == 'colors': raise ValueError('no compiler')"
    )
    numba_runtime.have_compiled()
    assert not (tmp_path / "complete").exists() and not left.exists()
    assert "ValueError: no compiler" in capsys.readouterr().err
    monkeypatch.setattr(numba_runtime, "COMPILE", "")
    numba_runtime.have_compiled()
    assert (tmp_path / "complete").exists()
    monkeypatch.setattr(numba_runtime, "_compile_into", None)
    numba_runtime.have_compiled()


def double(x):
    return 2 * x


def test_where_no_folder_can_be_written_it_is_said_and_a_kernel_works(monkeypatch, capsys):
    monkeypatch.setattr(numba_runtime, "FOLDER", None)
    numba_runtime.have_compiled()
    assert "NUMBA_CACHE_DIR" in capsys.readouterr().err
    doubled = kernel()(double)
    assert doubled(4) == 8 and doubled.stats.cache_path is None


@numba.njit
def call_fma(a, b, c):
    return fma(a, b, c)


def test_fma_rounds_once():
    a = np.float32(1 + 2**-12)
    # a^2 = 1 + 2^-11 + 2^-24; rounded to float32 first, the last term would be lost.
    assert call_fma(a, a, np.float32(-1 - 2**-11)) == np.float32(2**-24)
