"""Write docs/results/photo_tourism.md from the records."""

from __future__ import annotations

from pathlib import Path
from string import Template

from lab.documents import RESULTS
from lab.grid.figures import Reference
from lab.grid.records import Record, Records, is_current, load
from lab.grid.sources import Cell, sourced_table
from lab.photo_tourism.runs import FILE, SETTINGS, STEPS, STUDY, run_of

REPORT = RESULTS / "photo_tourism.md"
TEMPLATE = Path(__file__).with_name("photo_tourism.md.template")

FORMS = {
    "psnr": ".2f",
    "ssim": ".3f",
    "psnr_before": ".2f",
    "mask_iou": ".2f",
    "alpha_outside_masks": ".3f",
    "num_static_gaussians": ",.0f",
    "num_distractor_gaussians": ",.0f",
    "train_cpu_seconds": ",.0f",
}
"""How the figures are written, in the order of the columns."""

HEAD = ["effects that are on", "PSNR, dB", "SSIM", "average light", "mask IoU", "alpha outside"]
HEAD += ["static", "distractors", "training, CPU s"]


def scene_table(records: Records, scene: str, today: Reference) -> str:
    """One row for each setting that was measured with today's settings."""
    rows: list[list[str | Cell]] = []
    for name, setting in SETTINGS.items():
        run = run_of(name, scene)
        record = records.get(run.name)
        if record is None or not is_current(record, today(run)):
            continue
        texts = [_text(record, figure, form) for figure, form in FORMS.items()]
        cells = [Cell(text, ((run, record),)) for text in texts]
        rows.append([setting.what, *cells])
    return sourced_table(HEAD, rows) if rows else "Not measured."


def _text(record: Record, figure: str, form: str) -> str:
    return format(record.figures[figure], form) if figure in record.figures else ""


def report(records: Records, today: Reference = STUDY.settings_of) -> str:
    """The document's text; `today` as `Figures` has it."""
    values: dict[str, object] = {f"table_{s}": scene_table(records, s, today) for s in STEPS}
    return Template(TEMPLATE.read_text()).substitute(
        values, **{f"steps_{scene}": f"{steps:,}" for scene, steps in STEPS.items()}
    )


def write_report() -> Path:
    """Write the document from the file in docs/; returns where it is."""
    REPORT.write_text(report(load(FILE)))
    return REPORT
