"""Do the runs of the study that have no record yet, then write their table.

    python -m lab.study --group separation --only 'desplat-few*' --jobs 2

It goes on where it was stopped. Without DESPLAT_NS_DATA, the folder with the real captures, runs on
generated ones can be chosen. The table is outputs/study/table.md; --records names another file of
records, for instance an empty one to measure this commit.
"""

from __future__ import annotations

import argparse
import itertools
import shlex
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path
from statistics import median

from desplat_ns.core.errors import DeSplatError
from desplat_ns.core.whole import only_process_in
from desplat_ns.tools.studies.machine import short, today
from desplat_ns.tools.studies.records import Key, Record, load
from desplat_ns.tools.studies.runs import Executor, Run, execute
from lab import OUTPUTS, RECORDS, markdown_table, parser_of
from lab.study.captures import CAPTURES
from lab.study.variants import GROUPS, SEEDS, VARIANTS, Wanted, run_of

SCORES = {
    "psnr": ("PSNR, dB", ".2f"),
    "psnr_worst": ("worst view", ".2f"),
    "ssim": ("SSIM", ".3f"),
    "mask_iou": ("mask IoU", ".2f"),
    "alpha_outside_masks": ("alpha outside", ".3f"),
    "num_static_gaussians": ("static", ",.0f"),
    "num_distractor_gaussians": ("distractors", ",.0f"),
    "train_cpu_seconds": ("CPU, s", ".0f"),
}
"""Scores that are recorded: their names in the table, and how they are written there."""


def do(run: Run, folder: Path) -> Record:
    """Train and score; of the scores those of the table are recorded."""
    record = execute(run, folder)
    scores = {name: record.scores[name] for name in SCORES if name in record.scores}
    return replace(record, scores=scores)


def wanted_runs(group: str, patterns: Sequence[str]) -> list[Wanted]:
    """Runs of a group, or of `all`, whose `variant-capture` matches a pattern.

    Raises:
        DeSplatError: none does.
    """
    groups = GROUPS if group == "all" else {group: GROUPS[group]}
    every = dict.fromkeys(wanted for runs in groups.values() for wanted in runs)
    chosen = [w for w in every if any(fnmatch(f"{w[0]}-{w[1]}", pattern) for pattern in patterns)]
    if not chosen:
        raise DeSplatError(
            f"No run matches {' '.join(patterns)}. Variants: {', '.join(VARIANTS)}. Captures: "
            f"{', '.join(CAPTURES)}."
        )
    return chosen


def spread(values: Sequence[float | int], form: str) -> str:
    """Median, and in brackets the least and the largest of several; empty where there is none."""
    if not values:
        return ""
    text = format(median(values), form)
    return f"{text} ({min(values):{form}} - {max(values):{form}})" if len(values) > 1 else text


def gaps(records: Mapping[Key, Record], variant: str, capture: str, steps: int) -> list[float]:
    """The share of the way from "off" to the clean twins, seed by seed."""
    shares = []
    for seed in SEEDS:
        runs = (run_of(name, capture, steps, seed) for name in (variant, "off", "twins"))
        found = [records[run.key].scores["psnr"] for run in runs if run.key in records]
        if len(found) == 3:
            ours, off, top = found
            shares.append((ours - off) / (top - off))
    return shares


def rows_of(chosen: Sequence[Wanted], records: Mapping[Key, Record]) -> Iterator[list[str]]:
    """A row for each variant on each capture that was measured."""
    cells = dict.fromkeys((capture, variant, steps) for variant, capture, steps, _ in chosen)
    for capture, variant, steps in sorted(cells, key=lambda cell: [*CAPTURES].index(cell[0])):
        keys = (run_of(variant, capture, steps, seed).key for seed in SEEDS)
        found = [records[key] for key in keys if key in records]
        if found:
            scores = (
                spread([r.scores[name] for r in found if name in r.scores], form)
                for name, (_, form) in SCORES.items()
            )
            gap = spread(gaps(records, variant, capture, steps), ".2f")
            yield [capture, VARIANTS[variant].what, f"{steps:,}", str(len(found)), gap, *scores]


def page(chosen: Sequence[Wanted], records: Mapping[Key, Record], command: str) -> str:
    """The dated table, with the command, the commits and the processors that its records name."""
    head = ["capture", "variant", "steps", "seeds", "gap closed", *(n for n, _ in SCORES.values())]
    table = markdown_table(head, rows_of(chosen, records), "ll" + "r" * (len(head) - 2))
    keys = dict.fromkeys(run_of(*wanted).key for wanted in chosen)
    found = [records[key] for key in keys if key in records]

    def counted(values: Iterable[str]) -> str:
        return ", ".join(f"{name} ({count})" for name, count in Counter(values).most_common())

    return (
        f"{today()}, by `{command}`. Median (least - largest) over the seeds. *Gap closed* is the "
        "share of the way from off to the clean twins.\n\n"
        f"{table}\n\n"
        f"Commits (runs): {counted(short(record.commit) for record in found)}. "
        f"On: {counted(record.device for record in found)}.\n"
    )


def finish(chosen: argparse.Namespace, wanted: Sequence[Wanted]) -> dict[str, str]:
    """Do what has no record; why runs failed, by their names."""
    output, records, lost = chosen.output, load(chosen.records), dict[str, str]()

    def coming() -> Iterator[Run]:
        for run in itertools.starmap(run_of, wanted):
            if run.key not in records:
                try:  # what is generated is made here, once
                    yield replace(run, data=CAPTURES[run.capture].locate(output).resolve())
                except DeSplatError as error:
                    lost[run.name] = str(error)
                    print(f"{run.name}: {error}", file=sys.stderr, flush=True)

    output.mkdir(parents=True, exist_ok=True)
    with only_process_in(output):
        executor = Executor(jobs=chosen.jobs, do=do)
        return executor.finish(coming(), records, chosen.records, output) | lost


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; the exit status is 1 if a run failed, or if none is named so."""
    parser = parser_of("python -m lab.study", __doc__)
    parser.add_argument("--group", choices=(*GROUPS, "all"), default="separation")
    parser.add_argument("--only", nargs="+", default=["*"], help="variant-capture: 'off-table*'")
    parser.add_argument("--jobs", type=int, default=1, help="runs beside each other")
    parser.add_argument("--list", action="store_true", help="name the runs without a record; stop")
    parser.add_argument("--table", action="store_true", help="only write the table")
    parser.add_argument("--records", type=Path, default=RECORDS / "study.jsonl")
    parser.add_argument("--output", type=Path, default=OUTPUTS / "study")
    words = sys.argv[1:] if arguments is None else arguments
    chosen = parser.parse_args(words)
    try:
        wanted, records = wanted_runs(chosen.group, chosen.only), load(chosen.records)
        if chosen.list:
            runs = itertools.starmap(run_of, wanted)
            print(*(run.name for run in runs if run.key not in records), sep="\n")
            return 0
        failed = {} if chosen.table else finish(chosen, wanted)
    except DeSplatError as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    command = shlex.join(["python", "-m", "lab.study", *words])
    text = page(wanted, load(chosen.records), command)
    chosen.output.mkdir(parents=True, exist_ok=True)
    (chosen.output / "table.md").write_text(text, "utf8")
    print(text)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
