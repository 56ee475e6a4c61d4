"""Write gpu.md from the records: what was measured, and of the rest why it was not."""

from __future__ import annotations

from pathlib import Path
from string import Template

from lab.gpu import tables
from lab.gpu.plan import PARTS, TOTAL
from lab.gpu.records import WAITING, Record, Run
from lab.grid.tables import text_table

TEMPLATE = Path(__file__).with_name("gpu.md.template")
REPORT, PICTURE = "gpu.md", "gpu.png"

STAND_IN = (
    "**Stand-in: figures mean nothing.** The processor, or a tiny scene, stood in "
    "for what a GPU is to answer; this page shows that every part runs, and no more."
)

TRAININGS = ("training.cpu", "training.gpu", "training.real")


def report(run: Run) -> str:
    """The document's text."""
    parts = {part.name: run.parts.get(part.name, Record()) for part in PARTS}
    sections = {name: section(name, record) for name, record in parts.items()}
    trainings = [parts[name] for name in TRAININGS]
    sections["training"] = "\n\n".join(
        [
            *([tables.training(*(part.figures for part in trainings))] * any_figures(trainings)),
            *filter(None, (missing(part) for part in trainings)),
        ]
    )
    for name in TRAININGS:
        del sections[name]
    return Template(TEMPLATE.read_text("utf8")).substitute(
        sections,
        stand_in=STAND_IN if run.is_stand_in else "",
        overview=overview(run),
        picture=f"![Photo and rendering]({PICTURE})" if parts["training.real"].figures else "",
        minutes=f"{TOTAL / 60:.1f}",
    )


def write_report(run: Run, folder: Path) -> Path:
    """Write the document; returns where it is."""
    path = folder / REPORT
    path.write_text(report(run), "utf8")
    return path


def overview(run: Run) -> str:
    """How every part went."""
    rows = []
    for part in PARTS:
        record = run.parts.get(part.name, Record())
        seconds = f"{record.seconds:.0f}" if record.seconds else ""
        rows.append(
            [
                part.title,
                record.state,
                record.why,
                seconds,
                f"{record.deadline or part.deadline:.0f}",
            ]
        )
    return text_table(["part", "", "why", "s", "deadline, s"], rows)


def section(name: str, record: Record) -> str:
    """A part's figures, or why there are none; both where it was ended at its deadline."""
    texts = []
    if record.figures and name in tables.TABLES:
        texts.append(tables.TABLES[name](record.figures))
    said = missing(record)
    return "\n\n".join([*texts, *([said] if said else [])])


def missing(record: Record) -> str:
    """One paragraph on what is missing; nothing where all was measured."""
    if record.is_measured:
        return ""
    what = "Not measured in full" if record.figures else "Not measured"
    state = "" if record.state == WAITING else f"{record.state}"
    why = ": ".join(filter(None, (state, record.why))) or "the run had not come to it"
    return f"**{what}**: {why}."


def any_figures(records: list[Record]) -> bool:
    return any(record.figures for record in records)
