"""Figures of each part as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lab.gpu.records import Figures
from lab.grid.tables import text_table

PAPER, WANTED = 1.30, 1.15
"""A step of DeSplat over one of Splatfacto: in the paper, and at most here."""

METHODS = {"splatfacto": "Splatfacto", "desplat": "DeSplat"}

KINDS = {
    "waits": "waits of the host, all",
    "cudaStreamSynchronize": "of these for a stream",
    "cudaDeviceSynchronize": "of these for the device",
    "cudaEventSynchronize": "of these for an event",
    "cudaMemcpy": "of these for a copy",
    "Memcpy DtoH": "copies from the device",
    "Memcpy HtoD": "copies to the device",
    "aten::_local_scalar_dense": "numbers read by the host (`item`)",
    "aten::nonzero": "lists of indices (`nonzero`)",
    "launches": "kernels launched",
}


def machine(figures: Figures) -> str:
    """One line for each text."""
    return text_table(["", ""], [[name, text] for name, text in figures.items()])


def kernels(figures: Figures) -> str:
    """How long the compiler took."""
    jobs = figures["jobs"]
    how = f", {jobs} at a time" * (jobs > 0)
    for_what = f" for compute capability {figures['architecture']}" * bool(figures["architecture"])
    return f"Compiled or loaded in {figures['seconds']:.0f} s{how}{for_what}."


def suite(figures: Figures) -> str:
    """Numbers of tests, and what did not pass."""
    names = ("passed", "failed", "error", "skipped")
    parts = [text_table([*names], [[str(figures[name]) for name in names]])]
    if figures["bad"]:
        parts.append("\n".join(f"- {test}" for test in figures["bad"]))
    if figures["reasons"]:
        lines = [f"- {count} skipped: {why}" for why, count in figures["reasons"].items()]
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def parity(figures: Figures) -> str:
    """A row for each scene, reference and backend."""
    rows = []
    for row in figures["rows"]:
        worst = max(row["gradients"].items(), key=lambda item: item[1])
        errors = [f"{row[name]:.1e}" for name in ("largest", "largest_unflipped")]
        gradient = f"{worst[1]:.1e} ({worst[0]})"
        head = [row["scene"], row["reference"], row["contender"]]
        rows.append([*head, *errors, f"{row['flipped']:.1e}", gradient])
    head = ["scene", "reference", "backend", "largest error", "without flipped pixels"]
    return text_table([*head, "share flipped", "worst gradient"], rows)


def steps(figures: Figures) -> str:
    """A row for each scene and case, and whether the aim is reached."""
    rows = [
        [
            *(row["scene"], row["case"], spread(row["ms"], ".2f"), f"{row['ratio']:.2f}"),
            "" if row["mb"] is None else f"{row['mb']:,.0f}",
        ]
        for row in figures["rows"]
    ]
    head = ["scene", "case", "ms, median (tenths)", "over Splatfacto", "peak memory, MB"]
    ratios = [row["ratio"] for row in figures["rows"] if row["case"].startswith("DeSplat, 1,000")]
    verdict = "reached" if ratios and max(ratios) <= WANTED else "not reached"
    sums = ", ".join(f"{ratio:.2f}" for ratio in ratios)
    said = f"The paper has {PAPER:.2f}; wanted is {WANTED:.2f} at most: {verdict} ({sums})."
    return f"{text_table(head, rows)}\n\n{said}"


def synchronisations(figures: Figures) -> str:
    """A row for each kind of event, a column for each method."""
    methods = figures["methods"]
    rows = [
        [said, *(f"{methods[name][kind]:.1f}" if name in methods else "" for name in METHODS)]
        for kind, said in KINDS.items()
    ]
    steps = f"per step, mean of {figures['steps']}"
    return text_table([steps, *METHODS.values()], rows)


def rendering(figures: Figures) -> str:
    """A row for each scene and case, drawn and scored side by side."""
    rates: dict[tuple[str, str], dict[str, str]] = {}
    for row in figures["rows"]:
        rates.setdefault((row["scene"], row["case"]), {})[row["what"]] = spread(row["fps"], ".0f")
    rows = [[*key, rate["drawn"], rate["scored"]] for key, rate in rates.items()]
    return text_table(["scene", "", "drawn", f"drawn and scored ({figures['metrics']})"], rows)


def training(*trainings: Figures) -> str:
    """A row for each training that has figures."""
    rows = []
    for run in trainings:
        if run:
            where = f"{run['device']} ({run['backend']})"
            threads = str(run["threads"]) if run["device"] == "cpu" else ""
            seconds = f"{run['train_wall_seconds']:.0f}"
            sizes = [f"{run.get(f'num_{kind}_gaussians', 0):,}" for kind in KINDS_OF_GAUSSIANS]
            scores = [f"{run['psnr']:.2f}", f"{run['ssim']:.3f}", iou(run)]
            steps = f"{run['steps']:,}"
            rows.append([run["capture"], where, threads, steps, *scores, seconds, *sizes])
    head = ["capture", "device", "threads", "steps", "PSNR, dB", "SSIM", "mask IoU", "training, s"]
    return text_table([*head, "static", "distractors"], rows)


KINDS_OF_GAUSSIANS = ("static", "distractor")


def iou(figures: Figures) -> str:
    """Of the masks, where there were any to compare."""
    value = figures.get("mask_iou")
    return "" if value is None else f"{value:.2f}"


TABLES: Mapping[str, Callable[[Figures], str]] = {
    "machine": machine,
    "kernels": kernels,
    "suite": suite,
    "parity": parity,
    "steps": steps,
    "synchronisations": synchronisations,
    "rendering": rendering,
}
"""By part; both trainings share one."""


def spread(values: Mapping[str, Any], form: str) -> str:
    """`12.1 (11.8 - 13.0)`."""
    return (
        f"{format(values['median'], form)} "
        f"({format(values['low'], form)} - {format(values['high'], form)})"
    )
