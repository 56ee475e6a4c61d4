"""Each effect on and off, on photos of changing light; writes docs/photo_tourism.md.

    python -m benchmarks.photo_tourism --jobs 2        (it resumes where it was stopped)

Trained and evaluated through nerfstudio's commands, one thread each. DESPLAT_NS_DATA names the
folder that holds the real scene; without it, its runs fail, and say so.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from string import Template
from threading import Lock
from typing import Any

import numpy as np
from PIL import Image

from benchmarks.documents import CHECKOUT, DOCS, OUTPUTS
from desplat_ns.errors import DeSplatError
from desplat_ns.studies.grid.commands import QUIET, made, run_command
from desplat_ns.studies.grid.tables import table
from desplat_ns.synthetic import SceneSpec, write_scene

RECORDS = DOCS / "photo_tourism.json"
REPORT = DOCS / "photo_tourism.md"
TEMPLATE = Path(__file__).with_name("photo_tourism.md.template")

EFFECTS = "--pipeline.model.effects"
FIGURES = ("psnr_before", "num_static_gaussians", "num_distractor_gaussians", "mask_iou")
FIGURES += ("alpha_outside_masks", "embedding_seconds")
"""Of the evaluation's JSON, where they are there."""

_lock = Lock()


@dataclass(frozen=True)
class Setting:
    """A method and the switches of its effects."""

    what: str
    method: str
    appearance: str
    background: bool
    distractors: bool = True
    extra: tuple[str, ...] = ()

    @property
    def options(self) -> list[str]:
        return [
            *self.extra,
            *(f"{EFFECTS}.appearance", self.appearance),
            *(f"{EFFECTS}.background", str(self.background)),
            *(f"{EFFECTS}.distractors", str(self.distractors)),
        ]


A, FULL = "desplat-phototourism-a", "desplat-phototourism"
SETTINGS = {
    "plain": Setting("nothing (Splatfacto)", A, "off", False, distractors=False),
    "distractors": Setting("distractors", A, "off", False),
    "background": Setting("distractors, background", FULL, "off", True),
    "affine": Setting("distractors, affine (`desplat-phototourism-a`)", A, "affine", False),
    "sh": Setting("distractors, sh", A, "sh", False),
    "affine-background": Setting(
        "distractors, affine, background (`desplat-phototourism`)", FULL, "affine", True
    ),
    "sh-background": Setting("distractors, sh, background", FULL, "sh", True),
    "desplat": Setting(
        "affine, background, and the distractors of `desplat`",
        "desplat",
        "affine",
        True,
        extra=(
            "--pipeline.model.distractors.lambda-s",
            "0",
            "--pipeline.model.num-downscales",
            "0",
        ),
    ),
    "no-distractors": Setting("affine, background", FULL, "affine", True, distractors=False),
}
"""By name. lambda_s and lambda_bg are the method's."""

STEPS = {"yard": 1000, "sacre": 1000}
"""Training steps by scene: the generated one, and eight photos of Sacre Coeur."""

RUNS = [(setting, scene) for scene in STEPS for setting in SETTINGS]


def data_of(scene: str, folder: Path) -> Path:
    """The scene's folder; the generated one is made under `folder` at its first use.

    Raises:
        DeSplatError: the real scene is not there.
    """
    if scene == "yard":
        with _lock:
            return made(folder / "yard", lambda path: write_scene(SceneSpec.tourism(7), path))
    data = Path(os.environ.get("DESPLAT_NS_DATA", "")) / "sacre_coeur"
    if not data.is_dir():
        raise DeSplatError(
            f"The scene 'sacre_coeur' is not at '{data}'. Set DESPLAT_NS_DATA to the folder that "
            "holds it, or choose runs on the generated scene: --only '*-yard'."
        )
    return data


def right_half_psnr(pictures: Path) -> float:
    """Mean PSNR in dB of the right halves of pictures that show photo and rendering side by side.

    From 8-bit pictures, so that settings without an embedding are scored as those with one.
    """
    values = []
    for path in sorted(pictures.glob("*.png")):
        both = np.asarray(Image.open(path).convert("RGB"), dtype=np.float64) / 255
        photo, rendering = np.split(both, 2, axis=1)
        right = slice(photo.shape[1] // 2, None)
        error = float(np.mean((photo[:, right] - rendering[:, right]) ** 2))
        values.append(-10 * np.log10(error))
    return fmean(values)


def execute(setting: str, scene: str, folder: Path) -> dict[str, Any]:
    """Train and evaluate; the record of a run."""
    chosen, output = SETTINGS[setting], folder / f"{setting}-{scene}"
    output.mkdir(parents=True, exist_ok=True)
    train: list[object] = ["ns-train", chosen.method, "--data", data_of(scene, folder)]
    train += ["--max-num-iterations", STEPS[scene], "--output-dir", output, *QUIET]
    train += [*chosen.options, "photo-tourism-data"]
    started = time.perf_counter()
    run_command(train, output / "train.log")
    seconds = time.perf_counter() - started
    config = output / "x" / chosen.method / "run" / "config.yml"
    metrics, pictures = output / "metrics.json", output / "pictures"
    evaluate: list[object] = ["ns-eval", "--load-config", config, "--output-path", metrics]
    run_command([*evaluate, "--render-output-path", pictures], output / "eval.log")
    results = json.loads(metrics.read_text())["results"]
    return {
        "psnr": right_half_psnr(pictures),
        "train_seconds": round(seconds, 1),
        "steps": STEPS[scene],
        **{name: results[name] for name in FIGURES if name in results},
    }


def load() -> dict[str, dict[str, Any]]:
    """Records by `<setting>-<scene>`."""
    return json.loads(RECORDS.read_text()) if RECORDS.exists() else {}


def measure(setting: str, scene: str, folder: Path) -> bool:
    """Do one run and keep its figures; False where it failed, which is said."""
    name = f"{setting}-{scene}"
    try:
        record = execute(setting, scene, folder)
    except DeSplatError as error:
        print(f"{name}: {error}", file=sys.stderr, flush=True)
        return False
    with _lock:
        text = json.dumps(load() | {name: record}, indent=1, sort_keys=True)
        RECORDS.write_text(text + "\n")
    print(f"{name}: {record['psnr']:.2f} dB", flush=True)
    return True


def scene_table(records: dict[str, dict[str, Any]], scene: str) -> str:
    """One row for each setting that was measured."""
    head = ["effects that are on", "PSNR, dB", "average light", "mask IoU", "alpha outside"]
    rows = []
    for name, setting in SETTINGS.items():
        record = records.get(f"{name}-{scene}")
        if record is None or record["steps"] != STEPS[scene]:
            continue
        figures = [(key, ".2f") for key in ("psnr", "psnr_before", "mask_iou")]
        figures.append(("alpha_outside_masks", ".3f"))
        cells = [format(record[key], form) if key in record else "" for key, form in figures]
        for key in ("num_static_gaussians", "num_distractor_gaussians", "train_seconds"):
            cells.append(f"{record[key]:,.0f}")
        rows.append([setting.what, *cells])
    return table([*head, "static", "distractors", "training, s"], rows) if rows else "Not measured."


def report(records: dict[str, dict[str, Any]]) -> str:
    """The document's text."""
    values: dict[str, object] = {f"table_{s}": scene_table(records, s) for s in STEPS}
    return Template(TEMPLATE.read_text()).substitute(
        values, **{f"steps_{scene}": f"{steps:,}" for scene, steps in STEPS.items()}
    )


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.photo_tourism")
    parser.add_argument("--jobs", type=int, default=1, help="runs beside each other (%(default)s)")
    parser.add_argument("--only", nargs="+", default=["*"], help="runs by name, e.g. '*-yard'")
    parser.add_argument("--report", action="store_true", help="only write the document")
    folder = OUTPUTS / "photo_tourism"
    parser.add_argument("--output", type=Path, default=folder, help="of the runs")
    chosen, known, done = parser.parse_args(), load(), [True]
    if not chosen.report:
        missing = [
            (setting, scene)
            for setting, scene in RUNS
            if any(fnmatch.fnmatch(f"{setting}-{scene}", pattern) for pattern in chosen.only)
            and known.get(f"{setting}-{scene}", {}).get("steps") != STEPS[scene]
        ]
        chosen.output.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(chosen.jobs) as pool:
            done = list(pool.map(lambda run: measure(run[0], run[1], chosen.output), missing))
    REPORT.write_text(report(load()))
    print(f"written: {REPORT.relative_to(CHECKOUT)}")
    return 0 if all(done) else 1
