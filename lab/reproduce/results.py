"""Write docs/results/captures.md: one row for each method on each capture that was measured.

    python -m lab.reproduce.results

From the records of studies; nothing is trained. What the figures say is discussed in
docs/results/separation.md; here is what they were bought with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median

from desplat_ns.studies.machine import short
from lab.documents import RESULTS
from lab.grid.records import Record, Records, load
from lab.grid.runs import Run, Study
from lab.grid.tables import table
from lab.separation.report import NUMBERS_D, NUMBERS_S, README_ROWS, STILL
from lab.separation.runs import CLEAN, FILE
from lab.separation.runs import STUDY as SEPARATION
from lab.survey.runs import LIT, TRAINING
from lab.survey.runs import STUDY as SURVEY

PAGE = RESULTS / "captures.md"

BYTES = 4
"""Of a number."""

HEAD = ("capture", "method", "steps", "seeds", "PSNR, dB", "SSIM", "training, CPU s")
HEAD += ("static, MB", "distractors, MB", "commits")

TEXT = """# Results by capture

Written by `python -m lab.reproduce.results` from the records of studies; nothing else is here.
Medians of the seeds, on a CPU with one thread. Training is the CPU time of the steps alone,
on machines that did other work as well. Memory is that of the Gaussians: {s} numbers of 4 bytes
for a static one, {d} for a distractor.

## In one light

From `make study` ([separation.json](../records/separation.json)); what the figures mean is in
[separation.md](separation.md). Runs have Splatfacto's rates (`--full-rate-visits 0`) and
distractors on without a survey: what short runs give with the defaults is in
[accuracy-and-time.md](accuracy-and-time.md). Photos held out are scored whole, without distractors.

{separation}

## Each photo in a light of its own

From `python -m lab.survey.training` ([survey_training.json](../records/survey_training.json)), with
the defaults; see [survey.md](survey.md). Right halves of the photos held out are scored, in a light
found on the left half where the method has lights.

{survey}
"""


def measured(study: Study, records: Records) -> dict[Run, Record]:
    """Those of the study's runs that were measured."""
    return {run: records[run.name] for run in study.plan if run.name in records}


def rows_of(study: Study, records: Mapping[Run, Record]) -> list[list[str]]:
    """A row for runs that differ in nothing but their seed."""
    groups: dict[tuple[str, str, int], list[Record]] = {}
    for run, record in records.items():
        groups.setdefault((run.scene, run.setting, run.steps), []).append(record)
    return [
        [
            *(name_of(scene), study.settings[setting].what + ", clean twins" * is_twin(scene)),
            *(f"{steps:,}", str(len(seeds)), *figures_of(seeds)),
        ]
        for (scene, setting, steps), seeds in groups.items()
    ]


def is_twin(scene: str) -> bool:
    """Whether nothing was in the way."""
    return scene.endswith(CLEAN.removeprefix("-"))


def name_of(scene: str) -> str:
    """The capture, with what README calls it."""
    name = scene.removesuffix(CLEAN) if scene != "clean" else "clutter"
    return README_ROWS.get(name, f"`{STILL.get(name, name)}`")


def figures_of(runs: Sequence[Record]) -> list[str]:
    """Medians in words, empty where the records have no such figure."""

    def middle(name: str, form: str, times: float = 1.0) -> str:
        values = [run.figures[name] for run in runs if name in run.figures]
        return format(times * median(values), form) if values else ""

    commits = sorted({short(run.commit) for run in runs})
    return [
        *(middle("psnr", ".2f"), middle("ssim", ".3f"), middle("train_cpu_seconds", ",.0f")),
        middle("num_static_gaussians", ".1f", NUMBERS_S * BYTES / 1e6),
        middle("num_distractor_gaussians", ".1f", NUMBERS_D * BYTES / 1e6),
        ", ".join(commits),
    ]


def write() -> None:
    """Write the page."""
    lit = measured(SURVEY, load(TRAINING))
    studies = {
        "separation": rows_of(SEPARATION, measured(SEPARATION, load(FILE))),
        "survey": rows_of(SURVEY, {run: r for run, r in lit.items() if run.scene in LIT}),
    }
    tables = {name: table(HEAD, rows) for name, rows in studies.items()}
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(TEXT.format(s=NUMBERS_S, d=NUMBERS_D, **tables), "utf8")


if __name__ == "__main__":
    write()
