"""Does the suite notice a broken line? One line of a copy of the checkout is changed at a time.

The tests that should notice a change run in the copy, up to the first that fails.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from lab import CHECKOUT, markdown_table

TIMEOUT = 600
"""Seconds; a test that hangs has noticed, too."""

STABILITY = " ".join(f"tests/stability/test_stability_{n}.py" for n in ("catalogue", "properties"))
NUMBA = f"tests/backend/test_contract.py {STABILITY} -k numba"
FORMULAS = "tests/stability/test_stability_formulas.py tests/training/test_losses.py"


@dataclass(frozen=True)
class Mutation:
    """One line and what is put in its place."""

    name: str
    file: str
    """Below desplat_ns/."""
    old: str
    new: str
    tests: str
    """Arguments of pytest: where it should be noticed."""


_PIXELS, _PROJECTION, _SSIM = (
    f"backend/numba_kernels/{name}.py" for name in ("pixels", "projection", "ssim")
)

MUTATIONS = (
    Mutation("1 / (1 + alpha)", _PIXELS,
             "per_clear = _ONE / (_ONE - alpha)", "per_clear = _ONE / (_ONE + alpha)", NUMBA),
    Mutation("a gradient through the clamp of alpha", _PIXELS,
             "h if drawn & (raw <= alpha_max) else _ZERO", "h if drawn else _ZERO", NUMBA),
    Mutation("a sign in what lies behind", _PIXELS,
             "later + weight * q", "later - weight * q", NUMBA),
    Mutation("low-pass in the determinant", _PROJECTION,
             "xx + yy - _EPS2D", "xx + yy + _EPS2D", NUMBA),
    Mutation("a sign in the gradient by depth", _PROJECTION,
             "s[DEPTH + n] - v_per_z", "s[DEPTH + n] + v_per_z", NUMBA),
    Mutation("sizes not limited", _PROJECTION, "(abs(s[SX + n]) * pixels < _MOST)",
             "(abs(s[SX + n]) * pixels > -_MOST)", NUMBA),
    Mutation("a harmonic's slope", "backend/numba_kernels/sh.py",
             "per * (gx - along * x)", "per * (gx + along * x)", NUMBA),
    Mutation("ellipses too small", "backend/numba_kernels/ellipses.py",
             "np.sqrt(2 * s * c / det)", "np.sqrt(s * c / det)", NUMBA),
    Mutation("luminance plus structure", _SSIM,
             "score = luminance * structure", "score = luminance + structure", FORMULAS),
    Mutation("quaternions of length 0", "backend/inputs.py",
             "(norm2 > MIN_QUAT_NORM**2)", "(norm2 >= 0)", f"{STABILITY} -k torch"),
    Mutation("a sign in the transparency", "losses.py",
             "return 1 - alpha_s.sum()", "return 1 + alpha_s.sum()", FORMULAS),
    Mutation("opacities add up", "layers.py",
             "return alpha_d + (1 - alpha_d) * alpha_s", "return alpha_d + alpha_s",
             "tests/test_layers.py"),
    Mutation("log-scales that overflow", "gaussians/activation.py",
             "torch.exp(log_scales.clamp(max=MAX_LOG_SCALE))", "torch.exp(log_scales)", FORMULAS),
    Mutation("placing never stops", "distractors/distractors.py",
             "step.nominal < STOP_PLACING_AT", "step.nominal >= 0",
             "tests/distractors/test_placement.py"),
    Mutation("weak regions without a strong cell", "separation/decide.py",
             "keep[labels[strong]] = True", "keep[labels[weak]] = True",
             "tests/separation/test_decide.py"),
    Mutation("photos are held beyond the bound", "data/photo_cache.py",
             "range(most - 1 - self._ahead)", "range(most)",
             "tests/data/test_photo_cache.py"),
    Mutation("what stands still ties photos", "tools/process/reconstruction.py",
             "filter_stationary_matches = True", "filter_stationary_matches = False",
             "tests/tools/process/test_reconstruction.py"),
    Mutation("lenses darken no corners", "survey/photo_light.py",
             "rows[:, :, 4] = rho2[:, None]", "rows[:, :, 4] = 0",
             "tests/survey/test_survey.py -k lens"),
)  # fmt: skip


def copy_of_the_checkout(folder: Path) -> Path:
    """What the tests need, where it may be broken."""
    ignored = shutil.ignore_patterns("__pycache__")
    for name in ("desplat_ns", "tests", "lab"):
        shutil.copytree(CHECKOUT / name, folder / name, ignore=ignored)
    for name in ("pyproject.toml", "conftest.py"):
        shutil.copy(CHECKOUT / name, folder)
    return folder


def noticed_by(tests: str, folder: Path) -> tuple[str, bool]:
    """The first test that fails in a copy, and whether there is one."""
    places = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    command = [sys.executable, "-B", "-m", "pytest", "-x", "-p", "no:cacheprovider"]
    try:
        done = subprocess.run(
            [*command, *shlex.split(tests)],
            cwd=folder,
            env=os.environ | places,
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
        )
    except subprocess.TimeoutExpired:
        return "it hangs", True
    if done.returncode not in (0, 1):
        return f"NOT TRIED: pytest {tests} ended with {done.returncode}", False
    failed = re.search(r"^FAILED \S*?([^/\s]+::.*?)(?: - .*)?$", done.stdout, flags=re.M)
    return (failed[1], True) if failed else ("NOBODY", False)


def measured() -> tuple[str, bool]:
    """A row for each mutation with the test that noticed it, and whether all were noticed."""
    rows, is_kept = [], True
    with tempfile.TemporaryDirectory() as temporary:
        folder = copy_of_the_checkout(Path(temporary))
        for mutation in MUTATIONS:
            path = folder / "desplat_ns" / mutation.file
            source = path.read_text() if path.exists() else ""
            if source.count(mutation.old) == 1:
                path.write_text(source.replace(mutation.old, mutation.new))
                said, is_noticed = noticed_by(mutation.tests, folder)
                path.write_text(source)
            else:
                said, is_noticed = f"NOT TRIED: {mutation.file} has no such line", False
            is_kept &= is_noticed
            rows.append([mutation.name, said])
            print(f"{mutation.name}: {said}", flush=True)
    return markdown_table(["change", "noticed first by"], rows), is_kept
