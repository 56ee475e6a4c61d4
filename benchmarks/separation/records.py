"""What was measured, kept in one file, so that a stopped study goes on where it was."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.machine import CHECKOUT
from benchmarks.separation.runs import SETTINGS, Run

FILE = CHECKOUT / "docs" / "separation.json"

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


def add(run: Run, results: dict[str, Any], seconds: float, path: Path = FILE) -> None:
    """Put the figures of a run in the file.

    Args:
        results: as `ns-eval` writes them.
        seconds: that the training command took, start-up included.
    """
    records = load(path)
    record: dict[str, Any] = {name: results[name] for name in FIGURES if name in results}
    record["train_seconds"] = round(seconds, 1)
    record["options"] = list(SETTINGS[run.setting].options)
    records[run.name] = record
    path.write_text(json.dumps(records, indent=1, sort_keys=True) + "\n")


def is_done(run: Run, records: dict[str, dict[str, Any]]) -> bool:
    """Whether the run was measured, with the options that its setting has now."""
    found = records.get(run.name)
    return found is not None and found["options"] == list(SETTINGS[run.setting].options)
