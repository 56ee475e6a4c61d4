"""Write docs/results/survey.md from docs/records/survey.json."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

from desplat_ns.survey import background, distractors, findings, light
from lab.documents import RECORDS, RESULTS
from lab.grid.figures import Figures, Key, spread
from lab.grid.records import Records, load
from lab.grid.sources import Cell
from lab.grid.tables import text_table
from lab.survey.runs import SCENES, SEEDS, STEPS, TRAINING, downscale_of, settings_on
from lab.survey.unfamiliar import CHOSEN_ON, JUDGED

FILE = RECORDS / "survey.json"
REPORT = RESULTS / "survey.md"
TEMPLATE = Path(__file__).with_name("survey.md.template")

EFFECTS: dict[str, tuple[Any, ...]] = {
    "appearance": ("off", "camera", "affine"),
    "background": ("off", "constant", "sh", "image"),
    "distractors": (False, True),
}

DECIDING = {
    "appearance": ("change", "local"),
    "background": ("empty", "by_photo", "by_direction"),
    "distractors": ("covered", "judged"),
}
"""Figures by which each effect is decided."""


def confusion_table(records: Sequence[dict[str, Any]], effect: str) -> str:
    """Rows are truths, columns decisions, cells numbers of scenes; last the figures' ranges."""
    values = EFFECTS[effect]
    counts = Counter((r["truth"][effect], r["decisions"][effect]) for r in records)
    head = ["truth", *(f"says {value}" for value in values), *DECIDING[effect]]
    rows = []
    for truth in values:
        mine = [record for record in records if record["truth"][effect] == truth]
        cells = [str(counts[truth, value]) for value in values]
        rows.append([str(truth), *cells, *(_range(mine, name) for name in DECIDING[effect])])
    return text_table(head, rows)


def known_table(records: Sequence[dict[str, Any]]) -> str:
    """One row for each capture of which some decisions are known to be right."""
    names = [name for figures in DECIDING.values() for name in figures]
    head = ["scene", "photos", *EFFECTS, *names, "CPU, s", ""]
    rows = []
    for record in records:
        said = [f"{record['decisions'][e]} ({record['confidence'][e]})" for e in EFFECTS]
        figures = [_number(record["figures"].get(name)) for name in names]
        verdict = "wrong: " + ", ".join(record["wrong"]) if record["wrong"] else "right"
        seconds = f"{record['cpu_seconds']:.1f}"
        rows.append([record["name"], str(record["photos"]), *said, *figures, seconds, verdict])
    return text_table(head, rows)


def wrong_list(records: Sequence[dict[str, Any]]) -> str:
    """Every wrong decision with the figures that led to it."""
    lines = [
        f"- {record['name']}: {effect} {record['decisions'][effect]} "
        f"({record['confidence'][effect]}), "
        + ", ".join(f"{name} {_number(record['figures'].get(name))}" for name in DECIDING[effect])
        for record in records
        for effect in record["wrong"]
    ]
    return "\n".join(lines) or "None."


def share_right(records: Sequence[dict[str, Any]], effects: Sequence[str] = tuple(EFFECTS)) -> str:
    """`143 of 144 decisions (99.3%)`.

    Args:
        effects: that are judged.
    """
    total = len(effects) * len(records)
    right = total - sum(len(record["wrong"]) for record in records)
    return f"{right} of {total} decisions ({right / max(total, 1):.1%})"


SETTING_NAMES = ("`auto`", "nothing on", "everything on", "the nearest other")
"""In the order of `settings_on`."""


def training_table(trained: Records) -> str:
    """One row for each scene: PSNR and SSIM of each setting, and by how much the survey's choice is
    below the best of them."""
    figures = Figures(trained, SEEDS)
    rows: list[list[str | Cell]] = []
    for scene in SCENES:
        keys = [(setting, scene, downscale_of(scene), STEPS) for setting in settings_on(scene)]
        if not any(figures.has(key) for key in keys):
            continue
        cells: list[str | Cell] = [scene]
        for key in keys:
            cells.append(figures.cell(key, "psnr", ".2f"))
            cells.append(figures.cell(key, "ssim", ".3f"))
        blank = ["", ""] * (len(SETTING_NAMES) - len(keys))
        rows.append([*cells, *blank, *(_lost(figures, keys, name) for name in ("psnr", "ssim"))])
    head = [*(word for name in SETTING_NAMES for word in (name, "")), "lost by the choice", ""]
    return figures.table(["right halves, dB and SSIM", *head], rows)


def _lost(figures: Figures, keys: Sequence[Key], name: str) -> str | Cell:
    """The best figure less that of the first key, by seeds; nothing where the first has none."""
    first, *others = (figures.by_seed(key) for key in keys)
    lost, measured = [], []
    for seed in first:
        same = [first[seed], *(other[seed] for other in others if seed in other)]
        values = [float(record.figures[name]) for _, record in same]
        lost.append(max(values) - values[0])
        measured += same
    return Cell(spread(lost, ".2f" if name == "psnr" else ".3f"), tuple(measured)) if lost else ""


def report(records: dict[str, list[dict[str, Any]]], trained: Records) -> str:
    """The document's text.

    Args:
        records: of surveys.
        trained: of what was trained with their decisions and without.
    """
    visible = [record for record in records["evaluation"] if record["is_visible"]]
    faint = [record for record in records["evaluation"] if not record["is_visible"]]
    seconds = sorted(record["cpu_seconds"] for record in records["evaluation"])
    limits = {
        "eighth_stop": f"{light.EIGHTH_STOP:.1%}",
        "quarter_stop": f"{light.QUARTER_STOP:.1%}",
        "local_step": f"{light.LOCAL_STEP:.0%}",
        "local_share": f"{light.LOCAL_SHARE:.0%}",
        "visible_share": f"{background.VISIBLE_SHARE:.0%}",
        "by_photo": background.BY_PHOTO,
        "chroma_by_photo": background.CHROMA_BY_PHOTO,
        "range": background.RANGE,
        "covered": f"{distractors.COVERED_SHARE:.1%}",
        "judged": f"{distractors.JUDGED_SHARE:.0%}",
        "color_step": distractors.COLOR_STEP,
        "clear": findings.CLEAR,
    }
    tables = {f"{e}_table": confusion_table(visible, e) for e in EFFECTS}
    return Template(TEMPLATE.read_text("utf8")).substitute(
        limits,
        **tables,
        training_table=training_table(trained),
        training_steps=f"{STEPS:,}",
        right_setting=share_right(records["setting"]),
        right_visible=share_right(visible),
        right_faint=share_right(faint),
        wrong_setting=wrong_list(records["setting"]),
        wrong_visible=wrong_list(visible),
        wrong_faint=wrong_list(faint),
        right_real=share_right(records["real"]),
        real_table=known_table(records["real"]),
        chosen_names=", ".join(CHOSEN_ON),
        unfamiliar_table=known_table(records["unfamiliar"]),
        right_kept_out=share_right(
            [record for record in records["unfamiliar"] if not record["chosen_on"]], JUDGED
        ),
        right_chosen_on=share_right(
            [record for record in records["unfamiliar"] if record["chosen_on"]], JUDGED
        ),
        photos="\n".join(f"- {record['name']}: {record['seen']}." for record in records["real"]),
        seconds=f"{seconds[len(seconds) // 2]:.1f}",
        num_visible=len(visible),
        num_faint=len(faint),
        num_setting=len(records["setting"]),
    )


def write_report() -> Path:
    """Write the document from the file in docs/; returns where it is."""
    REPORT.write_text(report(json.loads(FILE.read_text("utf8")), load(TRAINING)), "utf8")
    return REPORT


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.3f}"


def _range(records: Sequence[dict[str, Any]], name: str) -> str:
    known = [v for r in records if (v := r["figures"].get(name)) is not None]
    return f"{min(known):.3f} to {max(known):.3f}" if known else ""
