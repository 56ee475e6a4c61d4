"""Write docs/results/captures.md: one row for each method on each capture that was measured.

    python -m lab.reproduce.results

From the records of studies; nothing is trained. What the figures say is discussed in
docs/results/separation.md; here is what they were bought with.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from statistics import median

from desplat_ns.studies.machine import short
from lab.documents import RESULTS
from lab.grid.records import Record, Records, State, load, state_of
from lab.grid.runs import Run
from lab.grid.tables import table
from lab.separation.records import FILE
from lab.separation.report import NUMBERS_D, NUMBERS_S, README_ROWS
from lab.separation.runs import CLEAN, SCENES, SEEDS, SETTINGS, STUDY, downscale_of

PAGE = RESULTS / "captures.md"

LENGTHS, BYTES = (1000, 3000, 30_000), 4
"""Steps of the study's runs; bytes of a number."""

COMPARED = ("off", "paper", "trimmed", "desplat", "truth")
"""Settings that are methods; the others of the study are changes to one."""

HEAD = ("capture", "method", "seeds", "PSNR, dB", "SSIM", "training, CPU s")
HEAD += ("static, MB", "distractors, MB", "commits")

TEXT = """# Results by capture

Written by `python -m lab.reproduce.results` from the records of `make study`
([separation.json](../records/separation.json)), those of today's settings; what they mean is in
[separation.md](separation.md). Runs have Splatfacto's rates (`--full-rate-visits 0`) and
distractors on without a survey: what short runs give with the defaults is in
[accuracy-and-time.md](accuracy-and-time.md). Medians of the seeds, on a CPU with one thread.
Training is the CPU time of the steps alone, on machines that did other work as well. Memory is
that of the Gaussians: {s} numbers of 4 bytes for a static one, {d} for a distractor. Photos held
out are scored whole, without distractors.

{tables}
"""


def runs() -> Iterator[Run]:
    """All that may be on the page, in the order of scenes."""
    for scene, setting, steps in product(SCENES, COMPARED, LENGTHS):
        downscale = downscale_of("clutter" if scene == "clean" else scene)
        for seed in SEEDS:
            yield Run(setting, scene, downscale, steps, seed)


def of_today(records: Records) -> Records:
    """Those that are of today's settings."""
    wanted = (run for run in runs() if state_of(STUDY, run, records)[0] is State.DONE)
    return {run.name: records[run.name] for run in wanted}


def rows_of(records: Records) -> list[tuple[int, list[str]]]:
    """Steps and a row for runs that differ in nothing but their seed."""
    found: dict[tuple[str, str, int], list[Record]] = {}
    for run in runs():
        if run.name in records:
            found.setdefault((run.setting, run.scene, run.steps), []).append(records[run.name])
    return [
        (steps, [name_of(scene), method_of(setting, scene), str(len(seeds)), *figures_of(seeds)])
        for (setting, scene, steps), seeds in found.items()
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
    rows = rows_of(of_today(load(FILE)))
    lengths = sorted({steps for steps, _ in rows}, reverse=True)
    parts = [
        f"## {steps:,} steps\n\n{table(HEAD, [row for one, row in rows if one == steps])}"
        for steps in lengths
    ]
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(TEXT.format(s=NUMBERS_S, d=NUMBERS_D, tables="\n\n".join(parts)), "utf8")


if __name__ == "__main__":
    write()
