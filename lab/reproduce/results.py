"""Write docs/results/captures.md: one row for each method on each capture that was measured.

    python -m lab.reproduce.results

From the records of studies; nothing is trained. What the figures say is discussed in
docs/results/separation.md; here is what they were bought with.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from statistics import median

from desplat_ns.studies.machine import short
from lab.documents import RESULTS
from lab.grid.records import Record, Records, load
from lab.grid.runs import Run
from lab.grid.tables import table
from lab.separation.records import FILE
from lab.separation.report import NUMBERS_D, NUMBERS_S, README_ROWS
from lab.separation.runs import CLEAN, SCENES, SEEDS, SETTINGS, downscale_of

PAGE = RESULTS / "captures.md"

LENGTHS, BYTES = (1000, 3000, 30_000), 4
"""Steps of the study's runs; bytes of a number."""

COMPARED = ("off", "paper", "trimmed", "desplat", "truth")
"""Settings that are methods; the others of the study are changes to one."""

HEAD = ("capture", "method", "seeds", "PSNR, dB", "SSIM", "training, CPU s")
HEAD += ("static, MB", "distractors, MB", "commits")

TEXT = """# Captures at hand

Written by `python -m lab.reproduce.results` from the records of `make study`
([separation.json](../records/separation.json)), which say of which settings each is; what they
mean is in [separation.md](separation.md). Medians of the seeds, on a CPU with one thread. Training
is the CPU time of the steps alone, on machines that did other work as well. Memory is that of the
Gaussians: {s} numbers of 4 bytes for a static one, {d} for a distractor. Photos held out are scored
whole, without distractors.

{tables}
"""


def rows_of(records: Records) -> list[tuple[int, list[str]]]:
    """Steps and a row for runs that differ in nothing but their seed, in the order of scenes."""
    found: dict[tuple[str, str, int, int], list[Record]] = {}
    for scene, setting, steps in product(SCENES, COMPARED, LENGTHS):
        downscale = downscale_of("clutter" if scene == "clean" else scene)
        for seed in SEEDS:
            run = Run(setting, scene, downscale, steps, seed)
            if run.name in records:
                found.setdefault((setting, scene, downscale, steps), []).append(records[run.name])
    return [
        (steps, [name_of(scene), method_of(setting, scene), str(len(runs)), *figures_of(runs)])
        for (setting, scene, _, steps), runs in found.items()
    ]


def name_of(scene: str) -> str:
    """The capture, with what README calls it."""
    name = scene.removesuffix(CLEAN) if scene != "clean" else "clutter"
    return README_ROWS.get(name, name)


def method_of(setting: str, scene: str) -> str:
    """The method, and whether nothing was in its way."""
    return SETTINGS[setting].what + ", clean twins" * scene.endswith("clean")


def figures_of(runs: Sequence[Record]) -> list[str]:
    """Medians in words, empty where the records have no such figure."""

    def middle(name: str, form: str, times: float = 1.0) -> str:
        values = [run.figures[name] for run in runs if name in run.figures]
        return format(times * median(values), form) if values else ""

    commits = sorted({short(run.commit) for run in runs if run.commit is not None})
    return [
        *(middle("psnr", ".2f"), middle("ssim", ".3f"), middle("train_cpu_seconds", ",.0f")),
        middle("num_static_gaussians", ".1f", NUMBERS_S * BYTES / 1e6),
        middle("num_distractor_gaussians", ".1f", NUMBERS_D * BYTES / 1e6),
        ", ".join(commits) or "not recorded",
    ]


def write() -> None:
    """Write the page."""
    records = load(FILE)
    rows = rows_of(records)
    lengths = sorted({steps for steps, _ in rows}, reverse=True)
    parts = [
        f"## {steps:,} steps\n\n{table(HEAD, [row for one, row in rows if one == steps])}"
        for steps in lengths
    ]
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(TEXT.format(s=NUMBERS_S, d=NUMBERS_D, tables="\n\n".join(parts)), "utf8")


if __name__ == "__main__":
    write()
