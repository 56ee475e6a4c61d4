"""What was measured, kept in one file, so that a stopped study goes on where it was."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.documents import DOCS
from benchmarks.separation.runs import SETTINGS, Run

FILE = DOCS / "separation.json"

BEFORE = DOCS / "separation_before.json"
"""The same of commit e944f25, whose refinements were as far apart as its schedules said: every 10
steps in short runs, every 100 in those of 30,000. Nothing writes to it any more."""

FIGURES = (
    "psnr",
    "ssim",
    "mask_iou",
    "alpha_outside_masks",
    "num_static_gaussians",
    "num_distractor_gaussians",
)
"""Of `ns-eval`; the mask scores are absent where there are no distractors or no masks."""


def load(path: Path = FILE) -> dict[str, dict[str, Any]]:
    """Records by the name of the run."""
    return json.loads(path.read_text()) if path.exists() else {}


def add(run: Run, results: dict[str, Any], path: Path = FILE) -> None:
    """Put the figures of a run in the file. `results`: of `train_and_score`."""
    records = load(path)
    record: dict[str, Any] = {name: results[name] for name in FIGURES if name in results}
    record["train_cpu_seconds"] = round(results["train_cpu_seconds"], 1)
    record["options"] = list(SETTINGS[run.setting].options)
    records[run.name] = record
    path.write_text(json.dumps(records, indent=1, sort_keys=True) + "\n")


def is_done(run: Run, records: dict[str, dict[str, Any]]) -> bool:
    """Whether the run was measured, with the options that its setting has now."""
    found = records.get(run.name)
    return found is not None and found["options"] == list(SETTINGS[run.setting].options)
