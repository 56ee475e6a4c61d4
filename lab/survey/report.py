"""Tables of surveys whose right decisions are known, and of trainings that follow them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lab.documents import OUTPUTS
from lab.grid.figures import Figures, Key, spread
from lab.grid.records import Records, load
from lab.grid.sources import Cell
from lab.grid.tables import text_table
from lab.survey.runs import SCENES, SEEDS, STEPS, TRAINING, downscale_of, settings_on

TRAINED = OUTPUTS / "survey_training" / "table.md"

EFFECTS: dict[str, tuple[str, ...]] = {
    "appearance": ("off", "camera", "affine"),
    "background": ("off", "constant", "sh", "image"),
}

DECIDING = {
    "appearance": ("change", "local"),
    "background": ("empty", "by_photo", "by_direction"),
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
        rows.append([truth, *cells, *(_range(mine, name) for name in DECIDING[effect])])
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


def report(records: dict[str, list[dict[str, Any]]]) -> str:
    """The tables of all kinds of captures, as Markdown.

    Args:
        records: of surveys, as `lab.survey.__main__` makes them.
    """
    parts = []
    for kind, surveyed in records.items():
        judged = ("appearance",) if kind == "unfamiliar" else tuple(EFFECTS)
        parts.append(f"## {kind}: {share_right(surveyed, judged)}")
        if surveyed and "truth" in surveyed[0]:
            parts += [confusion_table(surveyed, effect) for effect in EFFECTS]
            parts.append(wrong_list(surveyed))
        else:
            parts.append(known_table(surveyed))
    return "\n\n".join(parts) + "\n"


def write_trained() -> Path:
    """Write the table of what was trained; returns where it is."""
    TRAINED.parent.mkdir(parents=True, exist_ok=True)
    TRAINED.write_text(training_table(load(TRAINING)) + "\n", "utf8")
    return TRAINED


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.3f}"


def _range(records: Sequence[dict[str, Any]], name: str) -> str:
    known = [v for r in records if (v := r["figures"].get(name)) is not None]
    return f"{min(known):.3f} to {max(known):.3f}" if known else ""
