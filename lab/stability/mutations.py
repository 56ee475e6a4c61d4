"""Does the suite notice a wrong sign? One line is changed at a time.

    python -m lab.stability.mutations            (--only NAME for some)

Each change is made in a copy of the checkout, the tests named beside it run there, and the first
one that fails is written down in docs/records/stability.json. A change that no test notices
survives; the exit status says so.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lab.arguments import parser_of
from lab.documents import CHECKOUT, RECORDS

RECORD = RECORDS / "stability.json"

TIMEOUT = 600
"""Seconds; what hangs is noticed, too."""

STABILITY = " ".join(f"tests/stability/test_stability_{n}.py" for n in ("catalogue", "properties"))
TORCH = f"{STABILITY} -k torch"
PIXELS, EWA, SH, ELLIPSES = (
    f"tests/backend/numba_kernels/test_{name}.py {STABILITY} -k numba"
    for name in ("pixels", "projection", "sh", "ellipses")
)
"""The kernels' own tests first: they compile little."""
FORMULAS = (
    f"{STABILITY} tests/training/test_losses.py tests/rendering/test_compositing.py "
    "-k 'not torch and not numba'"
)
DENSIFICATION = "tests/gaussians/test_densification.py"
GRADIENTS = "tests/test_model_gradients.py"
RESPONSE = "tests/photo_tourism/test_camera_response.py"
PLAN = "tests/calibration/test_run_plan.py -k too_large"
MATCHES = "tests/process/test_matches.py"
SURVEY = "tests/survey/test_survey.py"
REGIONS, PHOTOS = "tests/separation/test_regions.py", "tests/data/test_photo_cache.py"


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


_BLEND, _PROJECT = "backend/blending.py", "backend/projection.py"
_PLAN = "calibration/run_plan.py"
_PIXELS, _EWA, _SH = (f"backend/numba_kernels/{name}.py" for name in ("pixels", "ewa", "sh"))

MUTATIONS = (
    # The torch backend
    Mutation("what lies behind is added to the gradient", _BLEND,
             "grad = own - suffix", "grad = own + suffix", TORCH),
    Mutation("1 / (1 - alpha) forgotten", _BLEND,
             ".mul(self.alpha).div_(self.clear)", ".mul(self.alpha)", TORCH),
    Mutation("a gradient through the clamp", _BLEND,
             "grad.masked_fill_(self.alpha >= ALPHA_MAX, 0)", "grad", TORCH),
    Mutation("transmittance grows", _BLEND, "clear = 1 - alpha", "clear = 1 + alpha", TORCH),
    Mutation("blending never stops", _BLEND,
             "alpha.masked_fill_(transmittance[:, 1:] <= TRANSMITTANCE_MIN, 0)", "pass", TORCH),
    Mutation("a sign in a moment", _BLEND,
             "-(uv - x * v - y * u", "-(uv - x * v + y * u", TORCH),
    Mutation("gradient by opacity times opacity", _BLEND, "total / floor", "total * floor", TORCH),
    Mutation("alpha not clamped", _BLEND, "opacity.clamp(max=ALPHA_MAX)", "opacity", TORCH),
    # Projection, in torch
    Mutation("low-pass in the determinant", _PROJECT,
             "(cov_xx + cov_yy - EPS2D)", "(cov_xx + cov_yy + EPS2D)", TORCH),
    Mutation("a sign in a minor", _PROJECT, "a1 * b2 - a2 * b1", "a1 * b2 + a2 * b1", TORCH),
    Mutation("sizes not limited", _PROJECT,
             "is_finite(splats) & (spread < MAX_PIXELS)", "is_finite(splats)", TORCH),
    Mutation("near plane forgotten", _PROJECT,
             "(z >= NEAR_PLANE) & ", "", TORCH),
    Mutation("the held slope", _PROJECT,
             "-(center / focal + margin)", "-(center / focal - margin)", TORCH),
    Mutation("culled rotations stay 0", _PROJECT,
             "splats.quats.masked_fill(culled, 0.5)", "splats.quats", TORCH),
    Mutation("antialiasing without a floor", _PROJECT,
             ".clamp(min=COMPENSATION_MIN**2)", "", TORCH),
    Mutation("tiles too few", "backend/tile_lists.py",
             "* (1 + SLACK) + SLACK", "* 0.5", TORCH),
    # What is sound, for all backends
    Mutation("quaternions of length 0", "backend/inputs.py",
             "(norm2 > MIN_QUAT_NORM**2)", "(norm2 >= 0)", TORCH),
    Mutation("colours of 1e38", "backend/inputs.py", "colors.flatten(1).square().sum(-1)",
             "colors.flatten(1).abs().amax(-1)",
             "tests/backend/test_inputs.py -k 'colours and torch'"),
    # The numba backend's pixels
    Mutation("numba: 1 / (1 + alpha)", _PIXELS,
             "per_clear = _ONE / (_ONE - alpha)", "per_clear = _ONE / (_ONE + alpha)", PIXELS),
    Mutation("numba: a gradient through the clamp", _PIXELS,
             "h if drawn & (raw <= alpha_max) else _ZERO", "h if drawn else _ZERO", PIXELS),
    Mutation("numba: blending never stops", _PIXELS,
             "drawn = visible & (behind > least)", "drawn = visible", PIXELS),
    Mutation("numba: what lies behind counted twice over", _PIXELS,
             "(later * per_clear - t * q)", "(later - t * q)", PIXELS),
    Mutation("numba: a sign in what lies behind", _PIXELS,
             "later + weight * q", "later - weight * q", PIXELS),
    Mutation("numba: a sign in the exponent", _PIXELS,
             "fma(a, dx, b * dy), fma(b, dx, c * dy)", "fma(a, dx, b * dy), fma(-b, dx, c * dy)",
             PIXELS),
    # The numba backend's projection
    Mutation("numba: low-pass in the determinant", _EWA,
             "sharp + eps * (xx + yy - eps)", "sharp + eps * (xx + yy + eps)", EWA),
    Mutation("numba: gradient of the antialiasing", _EWA,
             "v_det -= v_ratio * ratio * per_det", "v_det += v_ratio * ratio * per_det", EWA),
    Mutation("numba: a held slope that moves", _EWA,
             "(v_slope_x if slopes[0] == x * per_z else _ZERO)", "v_slope_x", EWA),
    Mutation("numba: a sign in the gradient by depth", _EWA,
             "s[DEPTH + n] - v_per_z", "s[DEPTH + n] + v_per_z", EWA),
    Mutation("numba: a cross product the wrong way round", _EWA,
             "_cross(b, v_minors), _cross", "_cross(v_minors, b), _cross", EWA),
    Mutation("numba: quaternions of length 1e-13", _EWA,
             "(norm2 > camera.least_norm2)", "(norm2 > _ZERO)", EWA),
    Mutation("numba: a sign in the gradient by a quaternion", _EWA,
             "_TWO * (vx - _TWO * x", "_TWO * (vx + _TWO * x", EWA),
    Mutation("numba: sizes not limited", _EWA, "(abs(s[SX + n]) * pixels < most)",
             "(abs(s[SX + n]) * pixels > -most)", EWA),
    # Its colours and tiles
    Mutation("numba: a harmonic's slope", _SH,
             "per * (gx - along * x)", "per * (gx + along * x)", SH),
    Mutation("numba: a gradient through a colour's clamp", _SH,
             "r = grad[3 * i] if not is_cut or out[3 * i] > _ZERO else _ZERO", "r = grad[3 * i]",
             SH),
    Mutation("numba: ellipses too small", "backend/numba_kernels/ellipses.py",
             "np.sqrt(2 * s * c / det)", "np.sqrt(s * c / det)", ELLIPSES),
    # Losses and compositing
    Mutation("SSIM: luminance plus structure", "backend/numba_kernels/ssim.py",
             "score = luminance * structure", "score = luminance + structure", FORMULAS),
    Mutation("SSIM: a sign in the gradient", "backend/numba_kernels/ssim.py",
             "- _TWO * mx * q", "+ _TWO * mx * q", FORMULAS),
    Mutation("compiled: owned pixels count double", "backend/numba_kernels/ssim.py",
             "y[first + j], _ONE - kept * o[j]", "y[first + j], _ONE + kept * o[j]", FORMULAS),
    Mutation("compiled: blocks beside distractors left out", "backend/numba_kernels/ssim.py",
             "is_scored = _is_asked_for(wanted, 2, 2,", "is_scored = _is_asked_for(wanted, 1, 1,",
             FORMULAS),
    Mutation("owned pixels count double", "losses.py",
             "(1 - (1 - leak) * owned) *", "(1 + (1 - leak) * owned) *", FORMULAS),
    Mutation("photo and rendering exchanged", "losses.py",
             "torch.lerp(photo, image.detach(), owned)",
             "torch.lerp(image.detach(), photo, owned)", FORMULAS),
    Mutation("a sign in the transparency", "losses.py",
             "return 1 - alpha_s.sum()", "return 1 + alpha_s.sum()", FORMULAS),
    Mutation("free opacity has its price", "losses.py",
             "(1 - free).flatten()", "(1 + 0 * free).flatten()", FORMULAS),
    Mutation("the scene shines through", "rendering/compositing.py",
             "over(rgb_d, alpha_d, rgb_s, cut)", "over(rgb_d, -alpha_d, rgb_s, cut)", FORMULAS),
    Mutation("compiled: blue is never cut", "backend/numba_kernels/over.py",
             "grad[i + _2] if is_blue else _ZERO", "grad[i + _2]", "tests/backend/test_over.py"),
    Mutation("opacities add up", "rendering/compositing.py",
             "return alpha_d + (1 - alpha_d) * alpha_s", "return alpha_d + alpha_s", FORMULAS),
    Mutation("the background shines through", "rendering/compositing.py",
             "over(rgb, alpha, background)", "over(rgb, -alpha, background)", FORMULAS),
    # Activations
    Mutation("colours beyond the range keep their gradient", "gaussians/activation.py",
             "(rgbs < 0) | (rgbs > 1)", "(rgbs < 0) & (rgbs > 1)", FORMULAS),
    Mutation("a sigmoid's slope", "gaussians/activation.py", "grad * y * (1 - y)",
             "grad * y * (1 + y)",
             FORMULAS),
    Mutation("log-scales that overflow", "gaussians/activation.py",
             "torch.exp(log_scales.clamp(max=MAX_LOG_SCALE))", "torch.exp(log_scales)", FORMULAS),
    # Training
    Mutation("distractors measured against a scene of size 1", "gaussians/densification.py",
             "DEPTH if self.by_pixels else 1.0", "1.0", DENSIFICATION),
    Mutation("distractors refined in their warm-up", "gaussians/densification.py",
             "max(static.warmup_length, config.static_warmup)", "static.warmup_length",
             DENSIFICATION),
    Mutation("placing never stops", "separation/layer.py",
             "step < STOP_PLACING_AT", "step >= 0",
             "tests/separation/test_placement.py"),
    Mutation("the composite trains the background", "separation/layer.py",
             "image.detach() if alone else image", "image", GRADIENTS),
    Mutation("the scene's own colours drift off into the cameras' responses",
             "photo_tourism/camera_response.py",
             "self.weight[:, :CENTRED].mean(dim=0)", "self.weight[:, :CENTRED].mean()", RESPONSE),
    Mutation("a mask over a part of the photo is no mask", "separation/regions.py",
             "torch.where(mask, photo", "torch.where(mask.any(), photo", GRADIENTS),
    Mutation("poses learn nothing", "lit_model.py",
             "pose = self.camera_optimizer.apply_to_camera(camera)",
             "pose = self.camera_optimizer.apply_to_camera(camera).detach()", GRADIENTS),
    Mutation("weak regions are found without a strong cell", "separation/regions.py",
             "keep[labels[strong]] = True", "keep[labels[weak]] = True", REGIONS),
    # Photos in bounded memory
    Mutation("photos are held beyond the bound", "data/photo_cache.py",
             "used + self._sizes[photo] > self._most", "used > self._most", PHOTOS),
    Mutation("the photo goes whose turn comes first", "data/photo_cache.py",
             "last = max(self._held", "last = min(self._held", PHOTOS),
    # What a budget buys
    Mutation("Gaussians beyond those that are measured cost nothing", _PLAN,
             "measured.fixed * max(1.0, expected / count) * placed", "measured.fixed * placed",
             PLAN),
    Mutation("photos cost what smaller ones do", _PLAN,
             "measured.whole_photo / shrink**2 * placed", "measured.whole_photo * placed", PLAN),
    # From photos to a capture
    Mutation("features only where a mask is black", "process/preparation.py",
             "_of_size(read_mask(path), photo, path)", "~_of_size(read_mask(path), photo, path)",
             "tests/process/test_masks.py"),
    Mutation("thorough models are neither filtered nor adjusted", "process/mapping.py",
             "if recipe.filter_error is not None and recipe.filter_angle is not None:", "if False:",
             "tests/process/test_mapping.py"),
    Mutation("what stands still ties photos", "process/matches.py",
             "filter_stationary_matches = True", "filter_stationary_matches = False", MATCHES),
    Mutation("photos that look least alike are compared", "process/matches.py",
             "likeness = similarities(", "likeness = -similarities(", MATCHES),
    Mutation("the focal length of EXIF is for the film's width", "process/photos.py",
             "lens.focal_35mm / 43.2666", "lens.focal_35mm / 36", "tests/process/test_photos.py"),
    # Which effects photos call for
    Mutation("how bright a sky is counts in any light", "survey/survey.py",
             'appearance.decision == "affine")', "False)", f"{SURVEY} -k sky"),
    Mutation("lenses darken no corners", "survey/photo_light.py",
             "rows[:, :, 4] = rho2[:, None]", "rows[:, :, 4] = 0", f"{SURVEY} -k lens"),
)  # fmt: skip


def mutated(mutation: Mutation, source: str) -> str:
    """The source with one line changed. AssertionError unless it is there exactly once."""
    assert source.count(mutation.old) == 1, f"{mutation.name}: {mutation.old!r} in {mutation.file}"
    return source.replace(mutation.old, mutation.new)


def copy_of_the_checkout(folder: Path) -> Path:
    """What the tests need, where it may be broken."""
    for name in ("desplat_ns", "tests", "lab"):
        shutil.copytree(
            CHECKOUT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in ("pyproject.toml", "conftest.py"):
        shutil.copy(CHECKOUT / name, folder)
    return folder


def noticed_by(tests: str, folder: Path) -> str | None:
    """The first test that fails in a copy; None if all pass.

    Raises:
        RuntimeError: pytest could not run at all, or ran nothing.
    """
    surroundings = os.environ | {
        "PYTHONPATH": str(folder),
        "NUMBA_CACHE_DIR": str(folder / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", *shlex.split(tests)]
    try:
        done = subprocess.run(
            command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=TIMEOUT
        )
    except subprocess.TimeoutExpired:
        return "it hangs"
    if done.returncode not in (0, 1):
        raise RuntimeError(f"pytest ended with {done.returncode}:\n{done.stdout[-2000:]}")
    failed = re.search(r"^FAILED \S*?([^/\s]+::.*?)(?: - .*)?$", done.stdout, flags=re.M)
    return failed[1] if failed else None


def check(chosen: Sequence[Mutation]) -> None:
    """Find out who notices each mutation, and write it down."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = copy_of_the_checkout(Path(temporary))
        for mutation in chosen:
            path = folder / "desplat_ns" / mutation.file
            source = path.read_text()
            path.write_text(mutated(mutation, source))
            test = noticed_by(mutation.tests, folder)
            path.write_text(source)
            write_down(mutation, test)
            print(f"{mutation.name}: {test or 'SURVIVES'}", flush=True)


def record() -> dict[str, str | None]:
    """The first test that noticed each mutation of today, None where nobody has."""
    known = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    return {m.name: known.get(m.name) for m in MUTATIONS}


def write_down(mutation: Mutation, test: str | None) -> None:
    RECORD.write_text(json.dumps(record() | {mutation.name: test}, indent=1) + "\n")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = parser_of("python -m lab.stability.mutations", __doc__)
    parser.add_argument("--only", nargs="+", help="names; by default all")
    only = parser.parse_args(arguments).only
    check([m for m in MUTATIONS if only is None or m.name in only])
    sys.exit(None in record().values())


if __name__ == "__main__":
    main()
